"""What a FEMM model may hold and an actuator file cannot say: each with its name and the remedy."""

from collections.abc import Iterable

import numpy as np

from femfit.core.amount import counted
from femfit.tables.femm.model import FemLabel, FemMaterial, FemModel
from femfit.tables.femm.notes import Notes

ANGLE_TOLERANCE = 0.01
"""Degrees off the axis that a magnetization may be: drawings give 90 or -90, rotated ones its rounding."""

SIGNIFICANT_SHARE = 1e-6
"""Relative difference of two permeabilities below which they are the same number, rounded."""


def check_limits(model: FemModel, notes: Notes) -> None:
    """Report everything in the file's properties that cannot be taken."""
    notes.problems.extend(_problem_kind(model))
    used = [label for label in model.labels if label.material is not None]
    materials = list(dict.fromkeys(label.material for label in used if label.material is not None))
    for n, material in enumerate(materials):
        notes.problems.extend(_material_limits(material))
        if material.name in {other.name for other in materials[:n]}:
            notes.problem(f"two different materials are named {material.name!r}. Rename one of them.")
    for label in used:
        notes.problems.extend(_label_limits(label))
    notes.problems.extend(_point_limits(model))


def axial_sign(label: FemLabel) -> float:
    """+1 for a block magnetised along +z, -1 along -z, 0 for neither; a negative H_c turns the magnet round."""
    if label.material is None or not label.material.coercivity:
        return 0.0
    sign = 1.0 if label.material.coercivity > 0 else -1.0
    angle = label.magnetization % 360.0
    if abs(angle - 90.0) <= ANGLE_TOLERANCE:
        return sign
    return -sign if abs(angle - 270.0) <= ANGLE_TOLERANCE else 0.0


def _problem_kind(model: FemModel) -> list[str]:
    found = []
    if model.problem_type != "axisymmetric":
        found.append(
            f"[ProblemType] is {model.problem_type[:40]!r}; femfit solves axisymmetric problems. "
            "Draw the actuator as a body of revolution, r to the right."
        )
    if model.frequency:
        found.append(
            f"[Frequency] is {model.frequency:g} Hz; femfit solves magnetostatics. Set it to 0 for the static field."
        )
    if model.version != 4.0:
        found.append(f"[Format] is {model.version:g}; only 4.0 is read. Open it with FEMM 4.2 and save it again.")
    if model.previous_solution and model.previous_type:
        found.append(
            f"[PrevType] {model.previous_type} starts from the solution {model.previous_solution[:60]!r} (incremental "
            "or frozen permeability). Clear the previous solution in the problem definition."
        )
    return found


def _material_limits(material: FemMaterial) -> Iterable[str]:
    name = f"material {material.name!r}"
    if min(material.mu_x, material.mu_y) <= 0:
        yield f"{name} has a permeability of {min(material.mu_x, material.mu_y):g}; it must be > 0. Correct Mu_x, Mu_y."
    elif abs(material.mu_x - material.mu_y) > SIGNIFICANT_SHARE * material.mu_x and not material.curve:
        yield (
            f"{name} is anisotropic, Mu_x = {material.mu_x:g} and Mu_y = {material.mu_y:g}; femfit's materials are "
            "isotropic. Give both the value along the flux."
        )
    if material.lamination_type in {0, 1, 2} and material.lamination_fill != 1.0 and material.magnetic:
        yield (
            f"{name} is laminated with a fill of {material.lamination_fill:g}; femfit's materials are solid. Set "
            "LamFill = 1 and give an effective permeability."
        )
    if material.coercivity and material.curve:
        flux, field = zip(*material.curve, strict=True)
        remanence = float(np.interp(abs(material.coercivity), field, flux))
        yield (
            f"{name} is a permanent magnet with a B-H curve "
            f"({counted(len(material.curve), 'point')}); femfit's magnets have a "
            f"straight recoil line. Clear its curve, give Mu of the line (about 1.05 for NdFeB) and H_c = B_r / (mu_0 "
            f"Mu); its curve has B_r = {remanence:.4g} T."
        )
    if material.current_density:
        yield (
            f"{name} carries a current density J = {material.current_density:g} MA/m^2; femfit's currents belong to "
            "the winding. Set J to 0 and put the block in a circuit with its turns."
        )


def _label_limits(label: FemLabel) -> Iterable[str]:
    magnet = label.material is not None and label.material.coercivity
    if magnet and label.direction_formula:
        yield (
            f"{label.place} has the magnetization formula {label.direction_formula!r}; femfit takes +z or -z. "
            "Give the angle 90 or -90."
        )
    elif magnet and not axial_sign(label):
        yield (
            f"{label.place} is magnetised at {label.magnetization:g} degrees; femfit takes magnets along the axis. "
            "Give the angle 90 or -90."
        )
    if label.external:
        yield (
            f"{label.place} lies in an external region (Kelvin transformation); femfit has an open boundary of its "
            "own. Delete the external region and its periodic boundary, keep the inner one."
        )


def _point_limits(model: FemModel) -> Iterable[str]:
    for point in model.points:
        held = point.property
        if held is None:
            continue
        place = f"point property {held.name!r} at (r, z) = ({point.r:g}, {point.z:g}) mm"
        if held.current_A:
            yield f"{place} is a filament with {held.current_A:g} A. Draw it as a block in a circuit."
        elif point.r > 0:
            yield f"{place} holds A at {held.potential:g}; femfit's field is free there. Remove the property."
