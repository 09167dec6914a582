"""What of a FEMM model is taken in another form: lamination, magnets with a curve, formulas that are a number."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from femfit.core.constants import MU_0
from femfit.tables.femm.model import FemLabel, FemMaterial, FemModel
from femfit.tables.femm.notes import Notes


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
