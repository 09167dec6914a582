"""The columns of a sweep table."""

COLUMNS: dict[str, str] = {
    "current_A": "coil current, positive attracts",
    "distance_m": "gap from the electromagnet's face to the nearest face of the moving part",
    "force_N": "on the moving part, positive towards the electromagnet",
    "flux_linkage_Wb": "of the coil",
    "inductance_H": "d(flux linkage)/d(current)",
    "coenergy_J": "W'(d, i) up to a constant",
    "hall_T": "B_z at the Hall element",
    "force_error_N": "estimated discretisation error of the force",
    "newton_iterations": "of a point with saturating parts",
    "newton_residual": "last correction relative to the solution, in the energy's norm",
    "status": "ok, or why the point has no result",
}
"""The contract's columns, in their order; further axes of a sweep follow as further columns."""

VARIANT = "variant"
"""Column of a parameter sweep: the number of the variant, from 1; the parameters follow it."""
