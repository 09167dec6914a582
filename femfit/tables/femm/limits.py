"""What a FEMM model may hold and an actuator file cannot say: each with its name and the remedy.

What of a FEMM model is taken in another form: lamination, magnets with a curve, formulas that are a number.
"""

import math
from collections.abc import Mapping
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
    _check_kind(model, notes)
    used = [label for label in model.labels if label.material is not None and not label.external]
    materials = list(dict.fromkeys(label.material for label in used if label.material is not None))
    for n, material in enumerate(materials):
        _check_material(material, notes)
        if material.name in {earlier.name for earlier in materials[:n]}:
            notes.say("material twice", name=material.name)
    for label in used:
        if label.material is not None and label.material.coercivity and label.direction_formula:
            notes.say("label formula", place=label.place, formula=label.direction_formula)
    for point in model.points:
        held = point.property
        place = f"point property {held.name!r} at (r, z) = ({point.r:g}, {point.z:g}) mm" if held else ""
        if held and held.current_A:
            notes.say("point filament", place=place, current=held.current_A)
        elif held and point.r > 0:
            notes.say("point held", place=place, potential=held.potential)


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


def _check_kind(model: FemModel, notes: Notes) -> None:
    if model.problem_type != "axisymmetric":
        notes.say("kind planar", kind=model.problem_type[:40])
    if model.version != 4.0:
        notes.say("kind version", version=model.version)
    if model.previous_solution and model.previous_type:
        notes.say("kind incremental", kind=model.previous_type, solution=model.previous_solution[:60])


def _check_material(material: FemMaterial, notes: Notes) -> None:
    name, mu_x, mu_y = material.name, material.mu_x, material.mu_y
    if min(mu_x, mu_y) <= 0:
        notes.say("material permeability", name=name, mu=min(mu_x, mu_y))
    elif abs(mu_x - mu_y) > SIGNIFICANT_SHARE * mu_x and not material.curve:
        notes.say("material anisotropic", name=name, mu_x=mu_x, mu_y=mu_y)
    if material.lamination_type in {0, 1, 2} and material.lamination_fill != 1.0 and material.magnetic:
        notes.say("material laminated", name=name, fill=material.lamination_fill)


def in_terms_of_femfit(model: FemModel, notes: Notes) -> FemModel:
    """The model with materials that an actuator file can hold, as far as there are such; it is said what changed."""
    if model.frequency:
        notes.say("frequency", frequency=model.frequency)
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
    notes.say("lamination", name=material.name, fill=fill)
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
    notes.say("magnet-curve", size=off, name=material.name, remanence=remanence, mu=mu, percent=100 * off)
    return replace(
        material,
        mu_x=mu,
        mu_y=mu,
        coercivity=float(np.copysign(remanence / (MU_0 * mu), material.coercivity)),
        curve=(),
    )
