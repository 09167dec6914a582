"""The columns of a sweep table."""

COLUMNS: dict[str, str] = {
    "current_A": "Current of the winding; a positive one attracts a magnet that is drawn to be attracted.",
    "distance_m": "Air gap from the electromagnet's face to the nearest face of the moving part.",
    "force_N": "Force on the moving part, positive towards the electromagnet.",
    "flux_linkage_Wb": "Flux linkage of the winding.",
    "inductance_H": "Slope of the flux linkage over the current.",
    "coenergy_J": "Co-energy W'(d, i), up to a constant.",
    "hall_T": "Axial flux density at the Hall element.",
    "force_error_N": "Estimated discretisation error of the force.",
    "newton_iterations": "Iterations of a point with saturating parts.",
    "newton_residual": "Last correction relative to the solution, in the norm of the energy.",
    "status": "`ok`, or why the point has no result.",
}
"""The contract's columns, in their order; further axes of a sweep follow as further columns."""

VARIANT = "variant"
"""Column of a parameter sweep: the number of the variant, from 1; the parameters follow it."""
