"""What can be wrong with a device or its bench, and what the sensors would then read, without noise.

Remanence, turns and saturation are solved again as changed drawings. Errors of stage, meters and temperatures act by
their definition, on the solved fields; the diagnosis seeks them by the same definition on the fitted model.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.constants import MU_0
from femfit.device.parts import Actuator, LinearMaterial, Material, NonlinearMaterial, Region
from femfit.field.sweep import Progress
from femfit.trial.field_table import Fields, FieldTable, solve_drawings

REMANENCE_STEP, TURNS_STEP = 0.1, 0.1
"""Changes that are solved, either way; in linear materials the parabola through three solutions is exact."""

IRON_T, FERRITE_T, IRON_PERMEABILITY = 1.8, 0.45, 600.0
"""Polarisation of soft parts that are drawn without a B-H curve, and the permeability that tells iron from ferrite."""

COPPER_PER_K = 3.93e-3
"""Temperature coefficient of copper's resistance at 20 degC, IEC 60028."""

MAGNET_PER_K, MAGNET_PER_K2 = -1.15e-3, -2e-6
"""Sintered NdFeB's remanence from 20 to 100 degC, of the order of data sheets: the curve bends downwards."""

BEND = 0.1
"""A load cell's or a shunt's gain error is larger by this part at full scale than at zero: no meter is quite linear."""

_MAGNET, _HALL, _IRON = "magnet", "Hall element", "iron without a curve"


@dataclass(frozen=True, eq=False)
class Conditions:
    """Settings of n readings, in the order of measuring: m, A, s since the start of the run, degC."""

    distance: FloatArray
    current: FloatArray
    time_s: FloatArray
    coil_C: FloatArray
    magnet_C: FloatArray


@dataclass(frozen=True, eq=False)
class Device:
    """A drawing's fields, and those of its changed forms."""

    actuator: Actuator
    drawn: FieldTable
    forms: Mapping[str, FieldTable]

    def changed(self, name: str, step: float, size: FloatArray | float, at: Conditions) -> Fields:
        """The fields at a relative change less the drawn ones: the parabola through the three solutions."""
        here = self.drawn.at(at.distance, at.current)
        less, more = (self.forms[name + sign].at(at.distance, at.current) - here for sign in "-+")
        x = np.asarray(size) / step
        return less.times(0.5 * x * (x - 1.0)) + more.times(0.5 * x * (x + 1.0))


Readings = Mapping[str, FloatArray]


@dataclass(frozen=True)
class HiddenError:
    """One thing that is wrong, up to its size."""

    limit: Callable[[Device], float]  # Takes the device; the largest size that is still believable
    channels: tuple[str, ...]  # Those that show it, of which a campaign records at least one
    needs: str = ""  # What the drawing must have; empty for nothing
    setting: Callable[[Device, float, Conditions], Conditions] | None = None
    fields: Callable[[Device, float, Conditions], Fields] | None = None
    reading: Callable[[Device, float, Conditions, Readings], Readings] | None = None


def true_readings(device: Device, at: Conditions, hidden: Mapping[str, float]) -> dict[str, FloatArray]:
    """What the sensors would read without noise; hidden errors by name, with their sizes."""
    errors = [(HIDDEN_ERRORS[name], size) for name, size in hidden.items()]
    for error, size in errors:
        at = error.setting(device, size, at) if error.setting else at
    fields = device.drawn.at(at.distance, at.current)
    for error, size in errors:
        fields = fields + error.fields(device, size, at) if error.fields else fields
    values = {
        "force_N": fields.force,
        "flux_linkage_Wb": fields.flux_linkage,
        "voltage_V": device.actuator.coil.resistance_ohm * at.current,
    }
    if device.actuator.hall is not None:
        values["hall_V"] = device.actuator.hall.quiescent_V + device.actuator.hall.sensitivity_V_per_T * fields.hall
    for error, size in errors:
        values |= error.reading(device, size, at, values) if error.reading else {}
    return values


def possible_errors(actuator: Actuator) -> list[str]:
    """The errors that can be hidden in a device."""
    regions = (*actuator.fixed, *actuator.moving.regions)
    there = {
        "": True,
        _MAGNET: any(map(_is_magnet, regions)),
        _HALL: actuator.hall is not None,
        _IRON: any(map(_is_soft, regions)),
    }
    return [name for name, error in HIDDEN_ERRORS.items() if there[error.needs]]


def solve_device(actuator: Actuator, directory: Path, *, workers: int, progress: Progress | None = None) -> Device:
    """Solve a drawing and the changed forms that its hidden errors need."""
    forms = {"drawn": actuator}
    for sign, factor in (("-", -1.0), ("+", 1.0)):
        forms[f"turns{sign}"] = replace(
            actuator, coils=(replace(actuator.coil, turns=(1.0 + factor * TURNS_STEP) * actuator.coil.turns),)
        )
        if "remanence" in possible_errors(actuator):
            forms[f"remanence{sign}"] = _with_materials(actuator, _is_magnet, _scaled(1.0 + factor * REMANENCE_STEP))
    if "core_saturation" in possible_errors(actuator):
        forms["saturating"] = _with_materials(actuator, _is_soft, _saturating)
    tables = solve_drawings(forms, directory, workers=workers, progress=progress)
    return Device(actuator, tables["drawn"], tables)


def _is_magnet(region: Region) -> bool:
    return region.material.remanence_T != 0.0


def _is_soft(region: Region) -> bool:
    material = region.material
    return isinstance(material, LinearMaterial) and not _is_magnet(region) and material.relative_permeability > 10.0


def _scaled(factor: float) -> Callable[[Material], Material]:
    return lambda material: LinearMaterial(material.name, material.relative_permeability, factor * material.remanence_T)


def _saturating(material: Material) -> Material:
    """A curve from the drawn permeability on: B = mu_0 H + J_s x / (1 + x), the law of Froehlich and Kennelly."""
    polarisation = IRON_T if material.relative_permeability > IRON_PERMEABILITY else FERRITE_T
    x = np.concatenate([[0.0], np.geomspace(0.02, 60.0, 48)])
    h = x * polarisation / (MU_0 * (material.relative_permeability - 1.0))
    b = MU_0 * h + polarisation * x / (1.0 + x)
    return NonlinearMaterial("saturating", tuple(b.tolist()), tuple(h.tolist()))


def _with_materials(
    actuator: Actuator, where: Callable[[Region], bool], change: Callable[[Material], Material]
) -> Actuator:
    def changed(regions: tuple[Region, ...]) -> tuple[Region, ...]:
        return tuple(replace(one, material=change(one.material)) if where(one) else one for one in regions)

    moving = replace(actuator.moving, regions=changed(actuator.moving.regions))
    return replace(actuator, fixed=changed(actuator.fixed), moving=moving)


def _largest_current(device: Device) -> float:
    return max(map(abs, device.actuator.sweep.currents_A))


def _largest_force(device: Device) -> float:
    near, most = device.actuator.sweep.distances_m[0], device.actuator.sweep.currents_A[-1]
    return float(np.abs(device.drawn.at(np.array([near]), np.array([most])).force)[0])


def _largest_shift(device: Device) -> float:
    low, high = device.drawn.distances
    return min(1e-3, 0.15 * low + 0.01 * (high - low))


def _warm_magnet(device: Device, size: float, at: Conditions) -> Fields:
    warmer = at.magnet_C - 20.0
    return device.changed("remanence", REMANENCE_STEP, size * (MAGNET_PER_K * warmer + MAGNET_PER_K2 * warmer**2), at)


def _saturation(device: Device, size: float, at: Conditions) -> Fields:
    saturating, drawn = (table.at(at.distance, at.current) for table in (device.forms["saturating"], device.drawn))
    return (saturating - drawn).times(abs(size))


def _resisted(share: Callable[[float, Conditions], FloatArray | float]) -> Callable[..., Readings]:
    """A reading of the voltage with a relative change of the resistance."""
    return lambda device, size, at, values: {
        "voltage_V": values["voltage_V"] + device.actuator.coil.resistance_ohm * share(size, at) * at.current
    }


_FIELD = ("force_N", "flux_linkage_Wb", "hall_V")
_BY_CURRENT = ("flux_linkage_Wb", "voltage_V", "force_N")

HIDDEN_ERRORS: Mapping[str, HiddenError] = {
    "distance_offset": HiddenError(
        _largest_shift,
        ("force_N",),
        setting=lambda device, size, at: replace(at, distance=at.distance + size),
    ),
    "distance_scale": HiddenError(
        lambda device: 0.03,
        ("force_N",),
        setting=lambda device, size, at: replace(at, distance=at.distance * (1 + size)),
    ),
    "remanence": HiddenError(
        lambda device: 0.2,
        _FIELD,
        _MAGNET,
        fields=lambda device, size, at: device.changed("remanence", REMANENCE_STEP, size, at),
    ),
    "turns": HiddenError(
        lambda device: 0.2,
        ("flux_linkage_Wb", "voltage_V"),
        fields=lambda device, size, at: device.changed("turns", TURNS_STEP, size, at),
        reading=_resisted(lambda size, at: size),  # the wire is longer by as much
    ),
    "resistance": HiddenError(lambda device: 0.3, ("voltage_V",), reading=_resisted(lambda size, at: size)),
    "coil_temperature": HiddenError(
        lambda device: 1.3,  # of copper's coefficient
        ("voltage_V",),
        reading=_resisted(lambda size, at: abs(size) * COPPER_PER_K * (at.coil_C - 20.0)),
    ),
    "magnet_temperature": HiddenError(
        lambda device: 2.5, _FIELD, _MAGNET, fields=lambda device, size, at: _warm_magnet(device, abs(size), at)
    ),
    "core_saturation": HiddenError(lambda device: 2.0, _FIELD[:2], _IRON, fields=_saturation),
    "force_offset": HiddenError(
        lambda device: 0.3 * _largest_force(device),
        ("force_N",),
        reading=lambda device, size, at, values: {"force_N": values["force_N"] + size},
    ),
    "force_gain": HiddenError(
        lambda device: 0.2,
        ("force_N",),
        reading=lambda device, size, at, values: {
            "force_N": values["force_N"]
            * (1.0 + size * (1.0 + BEND * np.abs(values["force_N"]) / _largest_force(device)))
        },
    ),
    "current_offset": HiddenError(
        lambda device: 0.02 * _largest_current(device),  # both current errors stay within the solved range
        _BY_CURRENT,
        setting=lambda device, size, at: replace(at, current=at.current + size),
    ),
    "current_gain": HiddenError(
        lambda device: 0.02,
        _BY_CURRENT,
        setting=lambda device, size, at: replace(
            at, current=at.current * (1.0 + size * (1.0 + BEND * np.abs(at.current) / _largest_current(device)))
        ),
    ),
    "hall_offset": HiddenError(
        lambda device: 0.3,
        ("hall_V",),
        _HALL,
        reading=lambda device, size, at, values: {"hall_V": values["hall_V"] + size},
    ),
    "flux_integrator_drift": HiddenError(
        lambda device: 1e-4,
        ("flux_linkage_Wb",),
        reading=lambda device, size, at, values: {"flux_linkage_Wb": values["flux_linkage_Wb"] + size * at.time_s},
    ),
}
"""By the name that the diagnosis should give. Sizes are relative or in SI units, mostly of either sign."""
