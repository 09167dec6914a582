"""Meters, stages, elements and thermometers that are wrong: zeros, scales, drifts, limits and warmth.

Warmth acts as the ``thermometer`` says, more ``hot inside``, or ``late``.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from femfit.device.parts import REFERENCE_TEMPERATURE
from femfit.trial.field_table import HiddenError
from support.trial.magnetics import remanence_drawings
from support.trial.truth import (
    BY_CURRENT,
    FIELD,
    Truth,
    always,
    bent,
    needing_hall,
    needing_magnet,
    of_force,
    of_reading,
    place,
)

COPPER_ZERO = -234.5
"""Temperature at which copper's resistance, drawn on linearly, would be zero: IEC 60028."""


def meter_errors(bend):
    """Every zero and scale of stage and meters, each with a bend that its definition does not have."""

    def current(device, settings):
        return settings.current / device.largest_current

    def reading(channel, weight, limit, along=None):
        """A channel with an error of a weight of its signal and the settings, bent along the signal or otherwise."""

        def form(device, settings, values):
            signal = _signal(device, values) if channel == "hall_V" else values[channel]
            x = along(device, settings) if along else signal / (float(np.abs(signal).max()) or 1.0)
            return weight(signal, settings) * bent(x, bend)

        error = of_reading(channel, limit, form)
        return always(error, lacks=needing_hall) if channel == "hall_V" else always(error)

    def setting(name, channels, limit, weight, along):
        """Settings that differ by a weight of them, bent along distance or current."""

        def change(device, size, settings):
            shift = size * weight(getattr(settings, name)) * bent(along(device, settings), bend)
            return replace(settings, **{name: getattr(settings, name) + shift})

        return always(HiddenError(limit, channels, setting=change))

    def one(*_):
        return 1.0

    def itself(signal, *_):
        return signal

    force = ("force_N",)
    return {
        "distance_offset": setting("distance", force, lambda device: device.largest_shift, one, place),
        "distance_scale": setting("distance", force, lambda _: 0.027, itself, place),
        "current_offset": setting("current", BY_CURRENT, lambda device: 0.018 * device.largest_current, one, current),
        "current_gain": setting("current", BY_CURRENT, lambda _: 0.018, itself, current),
        "force_offset": reading("force_N", one, of_force(0.3)),
        "constant_force": reading("force_N", one, of_force(0.3)),
        "force_gain": reading("force_N", itself, 0.2),
        "resistance": reading("voltage_V", itself, 0.3),
        "hall_offset": reading("hall_V", one, 0.3),
        "hall_coil_pickup": reading(
            "hall_V", lambda _, settings: settings.current, lambda device: 0.3 / device.largest_current, current
        ),
    }


def _signal(device, values):
    """The Hall element's output over its zero; without an element nobody asks for the latter."""
    return values["hall_V"] - (device.actuator.hall.quiescent_V if device.actuator.hall is not None else 0.0)


def hall_saturation(law):
    """A Hall element's output that bends towards a limit 1 / size: soon, late, or from two thirds of it on."""

    def law_of(x):
        if law == "tanh":
            return np.tanh(x)
        if law == "power":
            return x / (1.0 + np.abs(x) ** 3) ** (1.0 / 3.0)
        beyond = np.maximum(np.abs(x) - 2.0 / 3.0, 0.0)
        return np.sign(x) * (np.minimum(np.abs(x), 2.0 / 3.0) + np.tanh(3.0 * beyond) / 3.0)

    def reading(device, size, settings, values):
        signal, room = _signal(device, values), 1.0 / max(abs(size), 1e-9)
        return {"hall_V": values["hall_V"] - signal + room * law_of(signal / room)}

    return always(HiddenError(lambda device: 1.5, ("hall_V",), reading=reading), lacks=needing_hall)


def integrator(law):
    """A fluxmeter that drifts: ``square`` in each run, over all of them with ``no reset``, or until it is ``leaky``."""

    def course(_, settings, __):
        if law == "no reset":
            return settings.campaign_s
        duration = max(float(settings.time_s.max()), 1.0)
        if law == "square":
            return settings.time_s * (1.0 + settings.time_s / duration)
        return 0.3 * duration * (1.0 - np.exp(-settings.time_s / (0.3 * duration)))

    return always(of_reading("flux_linkage_Wb", 1e-4, course))


def drift(channel, law):
    """A zero that drifts over the campaign: on a ``line``, until ``settling``, or as a random ``walk`` beside that."""
    hall = channel == "hall_V"

    def build(device, rng):
        share, seed = float(rng.uniform(0.15, 0.6)), int(rng.integers(2**31))

        def course(_, settings, __):
            x = settings.campaign_s / max(float(settings.campaign_s.max()), 1.0)
            settled = (1.0 - np.exp(-x / share)) / (1.0 - np.exp(-1.0 / share))
            walk = np.cumsum(np.random.default_rng(seed).standard_normal(len(x))) / np.sqrt(len(x))
            return {"line": x, "settling": settled, "walk": settled + 0.3 * walk}[law]

        names = ("hall_drift",) if hall else ("force_drift", "force_offset", "constant_force")
        return of_reading(channel, 0.3 if hall else of_force(0.3), course, names=names)

    return Truth(build, "catalogue", needing_hall) if hall else Truth(build, "when")


def lagged(values, settings, seconds):
    """A first-order lag behind values, which starts at the first one of each run."""
    result = values.copy()
    for k in range(1, len(values)):
        if settings.run[k] == settings.run[k - 1]:
            keep = np.exp(-(settings.time_s[k] - settings.time_s[k - 1]) / seconds)
            result[k] = values[k] + keep * (result[k - 1] - values[k])
    return result


def winding(law):
    """Copper that warms, as much as its thermometer says, more inside, or before it."""

    def drop(device, settings, _):
        rise = settings.coil_C - REFERENCE_TEMPERATURE
        inside, ahead = rise * np.abs(rise) / 200.0, 3.0 * (settings.current / device.largest_current) ** 2
        rise = rise + {"thermometer": 0.0, "hot inside": inside, "late": ahead}[law]
        share = rise / (REFERENCE_TEMPERATURE - COPPER_ZERO)
        return device.actuator.coil.resistance_ohm * share * settings.current

    return always(of_reading("voltage_V", 1.3, drop, one_way=True))


def magnets(how, law):
    """Magnets that weaken as they warm: a curve of neodymium, a line of ferrite, or neodymium behind its thermometer.

    The fields are those of magnets that are weaker in a way of ``remanence_drawings``.
    """

    def build(device, rng):
        lag = float(rng.uniform(60.0, 300.0))
        slope, bend = {"thermometer": (-1.2e-3, -4e-6), "hot inside": (-2e-3, 0.0), "late": (-1.1e-3, -1e-6)}[law]

        def fields(device, size, settings):
            rise = settings.magnet_C - REFERENCE_TEMPERATURE
            rise = lagged(rise, settings, lag) if law == "late" else rise
            return device.change(f"remanence-{how}", abs(size) * (slope * rise + bend * rise**2), settings)

        return HiddenError(lambda device: 2.5, FIELD, fields=fields)

    return Truth(build, lacks=needing_magnet, families=partial(remanence_drawings, how=how))


def hall_element(law):
    """Zero and sensitivity of a Hall element, by the winding's temperature, the surroundings', or behind both."""

    def build(device, rng):
        per_volt, lag = float(rng.uniform(-1.0, 1.0)), float(rng.uniform(30.0, 200.0))

        def form(device, settings, values):
            temperature = {
                "thermometer": settings.coil_C,
                "hot inside": 0.6 * settings.coil_C + 0.4 * settings.magnet_C,
                "late": lagged(settings.magnet_C, settings, lag),
            }[law]
            return (temperature - REFERENCE_TEMPERATURE) * (1.0 + per_volt * _signal(device, values))

        return of_reading("hall_V", 2e-2, form)

    return Truth(build, lacks=needing_hall)


def load_cell(law):
    """A load cell whose ``zero``, ``span`` or ``both`` follow the winding's temperature late: no catalogue has it."""

    def build(device, rng):
        lag = float(rng.uniform(100.0, 900.0))

        def form(device, settings, values):
            start = np.r_[True, np.diff(settings.run) > 0]
            ambient = settings.coil_C[start][np.cumsum(start) - 1]
            warm = lagged(settings.coil_C - ambient, settings, lag)
            return warm * (law != "span") + warm * values["force_N"] / device.largest_force * (law != "zero")

        return of_reading("force_N", of_force(0.02), form, names=())

    return Truth(build, "unseen")
