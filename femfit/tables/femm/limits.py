"""What a FEMM model may hold and an actuator file cannot say: each with its name and the remedy.

What of a FEMM model is taken in another form: lamination, magnets with a curve, formulas that are a number.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from femfit.core.numerics import MU_0
from femfit.tables.femm.model import FemLabel, FemMaterial, FemModel
from femfit.tables.femm.options import Notes

ANGLE_TOLERANCE = 0.01
"""Degrees within which a magnetization is along an axis: drawings give 90 or -90, rotated ones its rounding."""

SIGNIFICANT_SHARE = 1e-6
"""Relative difference of two permeabilities below which they are the same number, rounded."""


def check_limits(model: FemModel, notes: Notes) -> None:
    """Report everything in the file's properties that cannot be taken."""
    notes.problems.extend(_problem_kind(model))
    used = [label for label in model.labels if label.material is not None and not label.external]
    materials = list(dict.fromkeys(label.material for label in used if label.material is not None))
    for n, material in enumerate(materials):
        notes.problems.extend(_material_limits(material))
        if material.name in {earlier.name for earlier in materials[:n]}:
            notes.problem(f"two different materials are named {material.name!r}. Rename one of them.")
    for label in used:
        notes.problems.extend(_label_limits(label))
    notes.problems.extend(_point_limits(model))


Direction = tuple[float, float]
"""Unit vector (r, z)."""


def magnet_direction(label: FemLabel) -> Direction | None:
    """Where a block's magnetization points; None for no magnet. A negative H_c turns the magnet round."""
    if label.material is None or not label.material.coercivity:
        return None
    angle = (label.magnetization + (0.0 if label.material.coercivity > 0 else 180.0)) % 360.0
    nearest = 90.0 * round(angle / 90.0)
    if abs(angle - nearest) <= ANGLE_TOLERANCE:
        angle = nearest
    r, z = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return round(r, 12) + 0.0, round(z, 12) + 0.0


def _problem_kind(model: FemModel) -> list[str]:
    problems = []
    if model.problem_type != "axisymmetric":
        problems.append(
            f"[ProblemType] is {model.problem_type[:40]!r}; femfit solves axisymmetric problems. "
            "Draw the actuator as a body of revolution, r to the right."
        )
    if model.version != 4.0:
        problems.append(f"[Format] is {model.version:g}; only 4.0 is read. Open it with FEMM 4.2 and save it again.")
    if model.previous_solution and model.previous_type:
        problems.append(
            f"[PrevType] {model.previous_type} starts from the solution {model.previous_solution[:60]!r} (incremental "
            "or frozen permeability). Clear the previous solution in the problem definition."
        )
    return problems


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


def _label_limits(label: FemLabel) -> Iterable[str]:
    if label.material is not None and label.material.coercivity and label.direction_formula:
        yield (
            f"{label.place} has the magnetization formula {label.direction_formula!r}; femfit's magnets have one "
            "direction a block. Give an angle, and divide the block where the direction changes."
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


def in_terms_of_femfit(model: FemModel, notes: Notes) -> FemModel:
    """The model with materials that an actuator file can hold, as far as there are such; it is said what changed."""
    if model.frequency:
        notes.warn(
            "frequency",
            f"The file is a problem of {model.frequency:g} Hz; its drawing and materials are taken for the static "
            "field, without eddy currents.",
            "Compare forces with those of FEMM at [Frequency] = 0.",
        )
    used = dict.fromkeys(label.material for label in model.labels if label.material is not None and not label.external)
    taken = {material: _straightened(_solid(material, notes), notes) for material in used}
    return replace(model, labels=tuple(_with(label, taken) for label in model.labels))


def _with(label: FemLabel, taken: Mapping[FemMaterial, FemMaterial]) -> FemLabel:
    material = None if label.material is None else taken.get(label.material, label.material)
    try:
        angle = float(label.direction_formula)
    except ValueError:
        return replace(label, material=material)
    return replace(label, material=material, magnetization=angle, direction_formula="")


def _solid(material: FemMaterial, notes: Notes) -> FemMaterial:
    """Sheets in the plane of the drawing with gaps between them, B = s B_sheet + (1 - s) mu_0 H."""
    fill = material.lamination_fill
    if material.lamination_type != 0 or not 0.0 < fill < 1.0 or not material.magnetic:
        return material
    notes.info(
        "lamination",
        f"Material {material.name!r} is laminated with a fill of {fill:g}; it is taken as solid with the mean of "
        "steel and air, as FEMM does.",
    )
    return replace(
        material,
        mu_x=fill * material.mu_x + 1.0 - fill,
        mu_y=fill * material.mu_y + 1.0 - fill,
        curve=tuple((fill * flux + (1.0 - fill) * MU_0 * field, field) for flux, field in material.curve),
        lamination_fill=1.0,
    )


def _straightened(material: FemMaterial, notes: Notes) -> FemMaterial:
    """A magnet with a demagnetisation curve as its recoil line, with the slope of the curve's upper half."""
    if not material.coercivity or len(material.curve) < 2:
        return material
    flux, field = (np.array(values) for values in zip(*material.curve, strict=True))
    coercivity = abs(material.coercivity)
    remanence, half = np.interp([coercivity, 0.5 * coercivity], field, flux)
    mu = max(1.0, float(2.0 * (remanence - half) / (MU_0 * coercivity)))
    inside = field <= coercivity
    line = np.maximum(remanence - MU_0 * mu * (coercivity - field[inside]), 0.0)
    off = float(np.max(np.abs(line - flux[inside]), initial=0.0) / remanence) if remanence > 0 else 0.0
    notes.warn(
        "magnet-curve",
        f"Magnet {material.name!r} has a demagnetisation curve; it is taken as its straight recoil line, B_r = "
        f"{remanence:.4g} T and mu_r = {mu:.4g}, which is up to {100 * off:.2g} % of B_r off the curve.",
        "Check that the magnet works above the knee of its curve.",
        off,
    )
    return replace(
        material,
        mu_x=mu,
        mu_y=mu,
        coercivity=float(np.copysign(remanence / (MU_0 * mu), material.coercivity)),
        curve=(),
    )
