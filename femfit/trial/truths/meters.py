"""Zeros and scales of stage and meters, each with a bend that its definition does not have."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.trial.device import Conditions, Device, HiddenError, Readings
from femfit.trial.truths.truth import BY_CURRENT, Bend, Build, Truth, bent, driven, moved, no_hall, place


def meter_errors(bend: Bend) -> Mapping[str, Truth]:
    """Every zero and scale, with one bend."""

    def current(device: Device, at: Conditions) -> FloatArray:
        return at.current / device.largest_current

    def added(channel: str, form: str, size: float, device: Device, at: Conditions, values: Readings) -> Readings:
        """A channel with an error that is a zero, or in proportion to its signal or to the current."""
        signal = values[channel] - _zero(device, channel)
        scale = float(np.abs(signal).max()) or 1.0
        weight = {"offset": np.ones_like(signal), "gain": signal, "pickup": at.current}[form]
        x = current(device, at) if form == "pickup" else signal / scale
        return {channel: values[channel] + size * weight * bent(x, bend)}

    def reading(channel: str, form: str, limit: float, of_force: bool = False) -> HiddenError:
        return HiddenError(
            lambda device: limit * (device.largest_force if of_force else 1.0),
            (channel,),
            reading=lambda device, size, at, values: added(channel, form, size, device, at, values),
        )

    distance_offset = HiddenError(
        lambda device: device.largest_shift,
        ("force_N",),
        setting=lambda device, size, at: moved(at, size * bent(place(device, at), bend)),
    )
    distance_scale = HiddenError(
        lambda _: 0.027,
        ("force_N",),
        setting=lambda device, size, at: moved(at, size * at.distance * bent(place(device, at), bend)),
    )
    current_offset = HiddenError(
        lambda device: 0.018 * device.largest_current,
        BY_CURRENT,
        setting=lambda device, size, at: driven(at, size * bent(current(device, at), bend)),
    )
    current_gain = HiddenError(
        lambda _: 0.018,
        BY_CURRENT,
        setting=lambda device, size, at: driven(at, size * at.current * bent(current(device, at), bend)),
    )
    plain = {
        "distance_offset": distance_offset,
        "distance_scale": distance_scale,
        "current_offset": current_offset,
        "current_gain": current_gain,
        "force_offset": reading("force_N", "offset", 0.3, of_force=True),
        "constant_force": reading("force_N", "offset", 0.3, of_force=True),
        "force_gain": reading("force_N", "gain", 0.2),
        "resistance": reading("voltage_V", "gain", 0.3),
    }
    hall = {
        "hall_offset": reading("hall_V", "offset", 0.3),
        "hall_coil_pickup": HiddenError(
            lambda device: 0.3 / device.largest_current,
            ("hall_V",),
            reading=lambda device, size, at, values: added("hall_V", "pickup", size, device, at, values),
        ),
    }
    return {name: Truth(_always(error)) for name, error in plain.items()} | {
        name: Truth(_always(error), lacks=no_hall) for name, error in hall.items()
    }


def _zero(device: Device, channel: str) -> float:
    element = device.actuator.hall
    return element.quiescent_V if element is not None and channel == "hall_V" else 0.0


def _always(error: HiddenError) -> Build:
    return lambda device, rng: error
