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
from femfit.trial.field_table import Conditions, Device, HiddenError, Readings, solve_drawings

REMANENCE_STEP = 0.1
"""Relative change that is solved, either way; in linear materials the parabola through three solutions is exact."""

FERRITE_T = 0.45
"""Polarisation of soft parts that are drawn without a B-H curve; iron holds four times as much."""

MAGNET_PER_K, MAGNET_PER_K2 = -1.15e-3, -2e-6
"""Sintered NdFeB's remanence from 20 to 100 degC, of the order of data sheets: the curve bends downwards."""

BEND = 0.1
"""A load cell's or a shunt's gain error is larger by this part at full scale than at zero: no meter is quite linear."""

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
    present = {
        "": True,
        _MAGNET: any(map(is_magnet, actuator.regions)),
        _HALL: actuator.hall is not None,
        _IRON: any(map(is_linear_iron, actuator.regions)),
    }
    return [name for name, error in HIDDEN_ERRORS.items() if present[error.needs]]


def solve_device(actuator: Actuator, directory: Path, *, workers: int, progress: Progress | None = None) -> Device:
    """Solve a drawing and the changed forms that its usual errors need."""
    possible, changed = possible_errors(actuator), dict[str, dict[float, Actuator]]()
    if "remanence" in possible:
        changed["remanence"] = {p: scaled_magnets(actuator, p) for p in (-REMANENCE_STEP, REMANENCE_STEP)}
    if "core_saturation" in possible:
        changed["saturating"] = {1.0: saturable_core(actuator, FERRITE_T)}
    named = {f"{name}{p:+g}": form for name, forms in changed.items() for p, form in forms.items()}
    tables = solve_drawings({"drawn": actuator} | named, directory, workers=workers, progress=progress)
    families = {name: {p: tables[f"{name}{p:+g}"] for p in forms} for name, forms in changed.items()}
    return Device(actuator, tables["drawn"], families)


Form = Callable[[Device, Conditions, FloatArray], FloatArray | float]
"""(device, settings, values) -> change of the values by an error, over its size."""


def _reads(
    channel: str, form: Form, of_size: Callable[[float], float] = float
) -> Callable[[Device, float, Conditions, Readings], Readings]:
    """A channel to which an error adds its size, or its magnitude, times a form."""
    return lambda device, size, settings, values: {
        channel: values[channel] + of_size(size) * form(device, settings, values[channel])
    }


def _sets(name: str, form: Form) -> Callable[[Device, float, Conditions], Conditions]:
    """A setting to which an error adds its size times a form."""
    return lambda device, size, settings: replace(
        settings, **{name: getattr(settings, name) + size * form(device, settings, getattr(settings, name))}
    )


def _ohmic(device: Device, settings: Conditions, _values: FloatArray) -> FloatArray:
    return device.actuator.coil.resistance_ohm * settings.current


_FIELD, _FORCE = ("force_N", "flux_linkage_Wb", "hall_V"), ("force_N",)
_BY_CURRENT = ("flux_linkage_Wb", "voltage_V", "force_N")

HIDDEN_ERRORS: Mapping[str, HiddenError] = {
    "distance_offset": HiddenError(
        lambda device: device.largest_shift, _FORCE, setting=_sets("distance", lambda *_: 1.0)
    ),
    "distance_scale": HiddenError(lambda _: 0.03, _FORCE, setting=_sets("distance", lambda _, __, d: d)),
    "remanence": HiddenError(
        lambda _: 0.2, _FIELD, _MAGNET, fields=lambda device, size, settings: device.change("remanence", size, settings)
    ),
    "turns": HiddenError(
        lambda device: 0.04 if device.actuator.saturates else 0.2,  # within the solved currents
        ("flux_linkage_Wb", "voltage_V"),
        fields=lambda device, size, settings: device.with_turns(size, settings),
        reading=_reads("voltage_V", _ohmic),  # the wire is longer by as much
    ),
    "resistance": HiddenError(lambda _: 0.3, ("voltage_V",), reading=_reads("voltage_V", _ohmic)),
    "coil_temperature": HiddenError(
        lambda _: 1.3,  # of copper's coefficient
        ("voltage_V",),
        reading=_reads(
            "voltage_V",
            lambda device, settings, values: (
                COPPER_TEMPERATURE_COEFFICIENT * (settings.coil_C - 20.0) * _ohmic(device, settings, values)
            ),
            abs,
        ),
    ),
    "magnet_temperature": HiddenError(
        lambda _: 2.5,
        _FIELD,
        _MAGNET,
        fields=lambda device, size, settings: device.change(
            "remanence",
            abs(size) * (settings.magnet_C - 20.0) * (MAGNET_PER_K + MAGNET_PER_K2 * (settings.magnet_C - 20.0)),
            settings,
        ),
    ),
    "core_saturation": HiddenError(
        lambda _: 2.0,
        _FIELD[:2],
        _IRON,
        fields=lambda device, size, settings: device.change("saturating", abs(size), settings),
    ),
    "force_offset": HiddenError(
        lambda device: 0.3 * device.largest_force, _FORCE, reading=_reads("force_N", lambda *_: 1.0)
    ),
    "force_gain": HiddenError(
        lambda _: 0.2,
        _FORCE,
        reading=_reads("force_N", lambda device, _, force: force * (1.0 + BEND * np.abs(force) / device.largest_force)),
    ),
    # Both current errors stay within the solved range
    "current_offset": HiddenError(
        lambda device: 0.02 * device.largest_current, _BY_CURRENT, setting=_sets("current", lambda *_: 1.0)
    ),
    "current_gain": HiddenError(
        lambda _: 0.02,
        _BY_CURRENT,
        setting=_sets("current", lambda device, _, i: i * (1.0 + BEND * np.abs(i) / device.largest_current)),
    ),
    "hall_offset": HiddenError(lambda _: 0.3, ("hall_V",), _HALL, reading=_reads("hall_V", lambda *_: 1.0)),
    "flux_integrator_drift": HiddenError(
        lambda _: 1e-4,
        ("flux_linkage_Wb",),
        reading=_reads("flux_linkage_Wb", lambda _, settings, __: settings.time_s),
    ),
}
"""By the name that the diagnosis should give. Sizes are relative or in SI units, mostly of either sign."""
