"""The usual errors of a device or its bench, by the name that the diagnosis should give.

Remanence, turns and saturation are solved again as changed drawings. Errors of stage, meters and temperatures act by
their definition, on the solved fields; the diagnosis seeks them by the same definition on the fitted model.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT, MU_0, FloatArray
from femfit.device.parts import Actuator, LinearMaterial, Material, NonlinearMaterial, Region, is_iron
from femfit.field.sweep import Progress
from femfit.trial.field_table import Conditions, Device, Family, HiddenError, Readings, solve_drawings

REMANENCE_STEP = 0.1
"""Relative change that is solved, either way; in linear materials the parabola through three solutions is exact."""

FERRITE_T = 0.45
"""Polarisation of soft parts that are drawn without a B-H curve; iron holds four times as much."""

MAGNET_PER_K, MAGNET_PER_K2 = -1.15e-3, -2e-6
"""Sintered NdFeB's remanence from 20 to 100 degC, of the order of data sheets: the curve bends downwards."""

BEND = 0.1
"""A load cell's or a shunt's gain error is larger by this part at full scale than at zero: no meter is quite linear."""

Stage = Callable[[Device, float, Conditions, Readings], Readings]

_IRON_PERMEABILITY = 600.0
"""Tells iron from ferrite."""

_MAGNET, _HALL, _IRON = "magnet", "Hall element", "iron without a curve"


def is_magnet(region: Region) -> bool:
    """Whether a region has a remanence."""
    return region.material.remanence_T != 0.0


def is_soft(region: Region) -> bool:
    """Whether a region is iron or ferrite."""
    return is_iron(region.material)


def is_linear_iron(region: Region) -> bool:
    """Whether a region is iron or ferrite that is drawn without a B-H curve."""
    return is_soft(region) and isinstance(region.material, LinearMaterial)


def with_materials(actuator: Actuator, change: Callable[[Region], Material]) -> Actuator:
    """A drawing whose parts have other materials, of which the field is solved anew."""
    fixed, moving = (
        tuple(replace(region, material=change(region)) for region in regions)
        for regions in (actuator.fixed, actuator.moving.regions)
    )
    return replace(actuator, fixed=fixed, moving=replace(actuator.moving, regions=moving))


def scaled_magnets(actuator: Actuator, change: float) -> Actuator:
    """Every magnet with 1 + change times its remanence."""

    def scaled(region: Region) -> Material:
        material = region.material
        if not isinstance(material, LinearMaterial):
            return material
        return replace(material, remanence_T=(1.0 + change) * material.remanence_T)

    return with_materials(actuator, scaled)


def saturable_core(
    actuator: Actuator, polarisation: float, law: Callable[[FloatArray], FloatArray] = lambda x: x / (1.0 + x)
) -> Actuator:
    """Every soft part that is drawn without a curve with J = J_s law(chi mu_0 H / J_s); law(x) rises as x to 1.

    The usual law is that of Froehlich and Kennelly, B = mu_0 H + chi mu_0 H / (1 + chi mu_0 H / J_s).

    Parameters
    ----------
    polarisation : float
        J_s of ferrite in T; iron has four times as much.

    References
    ----------
    R. M. Bozorth, Ferromagnetism (Van Nostrand, 1951), chapter 11.
    """

    def curve(region: Region) -> Material:
        if not is_linear_iron(region):
            return region.material
        largest = polarisation * (4.0 if region.material.relative_permeability > _IRON_PERMEABILITY else 1.0)
        x = np.concatenate([[0.0], np.geomspace(0.02, 60.0, 48)])
        h = x * largest / (MU_0 * (region.material.relative_permeability - 1.0))
        b = MU_0 * h + largest * law(x)
        return NonlinearMaterial("saturable", tuple(b.tolist()), tuple(h.tolist()))

    return with_materials(actuator, curve)


def possible_errors(actuator: Actuator) -> list[str]:
    """The errors that can be hidden in a device."""
    there = {
        "": True,
        _MAGNET: any(map(is_magnet, actuator.regions)),
        _HALL: actuator.hall is not None,
        _IRON: any(map(is_linear_iron, actuator.regions)),
    }
    return [name for name, error in HIDDEN_ERRORS.items() if there[error.needs]]


def solve_device(actuator: Actuator, directory: Path, *, workers: int, progress: Progress | None = None) -> Device:
    """Solve a drawing and the changed forms that its usual errors need."""
    possible, steps = possible_errors(actuator), (-REMANENCE_STEP, REMANENCE_STEP)
    changed: dict[str, dict[float, Actuator]] = {}
    if "remanence" in possible:
        changed["remanence"] = {step: scaled_magnets(actuator, step) for step in steps}
    if "core_saturation" in possible:
        changed["saturating"] = {1.0: saturable_core(actuator, FERRITE_T)}
    named = {f"{name}{p:+g}": form for name, forms in changed.items() for p, form in forms.items()}
    tables = solve_drawings({"drawn": actuator} | named, directory, workers=workers, progress=progress)
    families = {
        name: Family(tuple(forms), tuple(tables[f"{name}{p:+g}"] for p in forms), tables["drawn"])
        for name, forms in changed.items()
    }
    return Device(actuator, tables["drawn"], families)


def _added(channel: str, change: Callable[[Device, Conditions, FloatArray], FloatArray | float]) -> Stage:
    """A reading of a channel to which its size times ``change(device, settings, reading)`` is added."""
    return lambda device, size, settings, values: {
        channel: values[channel] + size * change(device, settings, values[channel])
    }


def _of_resistance(device: Device, settings: Conditions, _: FloatArray) -> FloatArray:
    return device.actuator.coil.resistance_ohm * settings.current


_FIELD = ("force_N", "flux_linkage_Wb", "hall_V")
_BY_CURRENT = ("flux_linkage_Wb", "voltage_V", "force_N")

HIDDEN_ERRORS: Mapping[str, HiddenError] = {
    "distance_offset": HiddenError(
        lambda device: device.largest_shift,
        ("force_N",),
        setting=lambda device, size, settings: replace(settings, distance=settings.distance + size),
    ),
    "distance_scale": HiddenError(
        lambda device: 0.03,
        ("force_N",),
        setting=lambda device, size, settings: replace(settings, distance=settings.distance * (1 + size)),
    ),
    "remanence": HiddenError(
        lambda device: 0.2,
        _FIELD,
        _MAGNET,
        fields=lambda device, size, settings: device.change("remanence", size, settings),
    ),
    "turns": HiddenError(
        lambda device: 0.04 if device.drawn.currents else 0.2,  # within the solved currents
        ("flux_linkage_Wb", "voltage_V"),
        fields=lambda device, size, settings: device.with_turns(size, settings),
        reading=_added("voltage_V", _of_resistance),  # the wire is longer by as much
    ),
    "resistance": HiddenError(lambda device: 0.3, ("voltage_V",), reading=_added("voltage_V", _of_resistance)),
    "coil_temperature": HiddenError(
        lambda device: 1.3,  # of copper's coefficient
        ("voltage_V",),
        reading=lambda device, size, settings, values: {
            "voltage_V": values["voltage_V"]
            + abs(size)
            * COPPER_TEMPERATURE_COEFFICIENT
            * (settings.coil_C - 20.0)
            * _of_resistance(device, settings, values["voltage_V"])
        },
    ),
    "magnet_temperature": HiddenError(
        lambda device: 2.5,
        _FIELD,
        _MAGNET,
        fields=lambda device, size, settings: device.change(
            "remanence",
            abs(size) * (settings.magnet_C - 20.0) * (MAGNET_PER_K + MAGNET_PER_K2 * (settings.magnet_C - 20.0)),
            settings,
        ),
    ),
    "core_saturation": HiddenError(
        lambda device: 2.0,
        _FIELD[:2],
        _IRON,
        fields=lambda device, size, settings: device.change("saturating", abs(size), settings),
    ),
    "force_offset": HiddenError(
        lambda device: 0.3 * device.largest_force,
        ("force_N",),
        reading=_added("force_N", lambda *_: 1.0),
    ),
    "force_gain": HiddenError(
        lambda device: 0.2,
        ("force_N",),
        reading=_added("force_N", lambda device, _, force: force * (1.0 + BEND * np.abs(force) / device.largest_force)),
    ),
    "current_offset": HiddenError(
        lambda device: 0.02 * device.largest_current,  # both current errors stay within the solved range
        _BY_CURRENT,
        setting=lambda device, size, settings: replace(settings, current=settings.current + size),
    ),
    "current_gain": HiddenError(
        lambda device: 0.02,
        _BY_CURRENT,
        setting=lambda device, size, settings: replace(
            settings,
            current=settings.current * (1.0 + size * (1.0 + BEND * np.abs(settings.current) / device.largest_current)),
        ),
    ),
    "hall_offset": HiddenError(lambda device: 0.3, ("hall_V",), _HALL, reading=_added("hall_V", lambda *_: 1.0)),
    "flux_integrator_drift": HiddenError(
        lambda device: 1e-4,
        ("flux_linkage_Wb",),
        reading=_added("flux_linkage_Wb", lambda device, settings, _: settings.time_s),
    ),
}
"""By the name that the diagnosis should give. Sizes are relative or in SI units, mostly of either sign."""
