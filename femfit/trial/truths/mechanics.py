"""Stops, springs, friction and screws: forces and places of which the field knows nothing."""

from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.trial.device import Conditions, Device, HiddenError, Readings
from femfit.trial.truths.truth import Bend, Truth, bent, moved, place


def stop(law: Literal["ball", "flat", "rubber"]) -> Truth:
    """Contact before the end: a round stop by Hertz (power 3/2), a flat one, or rubber that hardens, at the far end."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        low, high = device.actuator.sweep.distances_m[0], device.actuator.sweep.distances_m[-1]
        reach = float(rng.uniform(0.1, 0.3)) * (high - low)
        sign = 1.0 if law == "rubber" else -1.0

        def push(at: Conditions) -> FloatArray:
            depth = np.maximum(0.0, at.distance - (high - reach) if law == "rubber" else low + reach - at.distance)
            x = depth / reach
            return sign * {"ball": x**1.5, "flat": x, "rubber": x * (1.0 + x)}[law]

        return HiddenError(
            lambda device: 2.0 * device.largest_force,
            ("force_N",),
            reading=lambda _, size, at, values: {"force_N": values["force_N"] + abs(size) * push(at)},
            names=("end_stop_contact",),
            constants={"reach_m": reach},
        )

    return Truth(build)


def spring(law: Literal["straight", "conical", "pretensioned"]) -> Truth:
    """A spring that the drawing does not have: on a line, stiffer as it closes, or bearing from a length on alone."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        preload, free = (float(x) for x in rng.uniform([0.0, 0.6], [0.5, 0.9]))

        def push(at: Conditions) -> FloatArray:
            closed = 0.5 * (1.0 - place(device, at))
            if law == "pretensioned":
                return np.where(closed > 1.0 - free, closed - (1.0 - free) + preload, 0.0)
            return preload + closed * (1.0 + (0.2 * closed if law == "conical" else 0.0))

        return HiddenError(
            lambda device: 0.5 * device.largest_force,
            ("force_N",),
            # What pushes the parts apart is a smaller attraction
            reading=lambda _, size, at, values: {"force_N": values["force_N"] - abs(size) * push(at)},
            names=("spring",),
            constants={"preload": preload},
        )

    return Truth(build)


def carried_spring(bend: Bend) -> Truth:
    """A load cell that holds the body and so carries the drawn spring, which is not quite as drawn."""

    def reading(device: Device, size: float, at: Conditions, values: Readings) -> Readings:
        push = np.asarray(device.actuator.mechanics.push_of_springs(at.distance))
        return {"force_N": values["force_N"] - abs(size) * push * bent(place(device, at), bend)}

    def lacks(actuator: Actuator) -> str:
        return "" if actuator.mechanics.springs else "no spring"

    error = HiddenError(lambda _: 1.5, ("force_N",), reading=reading, names=("spring_in_force",))
    return Truth(lambda _, rng: error, lacks=lacks)


def friction(law: Literal["coulomb", "stribeck", "lugre"]) -> Truth:
    """Friction in the load cell's linkage, against the change of the force; no catalogue has it for a bench.

    The linkage gives way in proportion to the force. Dry friction turns with the direction; Stribeck's falls from its
    breakaway value as the steps grow; bristles (LuGre) bend first: df = (1 - f sign(dx) / g) dx / x_0.

    References
    ----------
    C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419.
    """

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        bristle, slow, more = (float(x) for x in rng.uniform([0.02, 0.01, 0.2], [0.2, 0.05, 1.0]))

        def reading(device: Device, size: float, at: Conditions, values: Readings) -> Readings:
            x = values["force_N"] / device.largest_force
            held = np.zeros(len(x))
            state = 0.0
            for k in range(1, len(x)):
                if at.run[k] != at.run[k - 1]:
                    state = 0.0
                    continue
                step = float(x[k] - x[k - 1])
                level = 1.0 + more * np.exp(-((step / slow) ** 2)) * (law != "coulomb")
                goal = np.sign(step) * level
                keep = np.exp(-abs(step) / (bristle * level)) if law == "lugre" else float(step == 0.0)
                state = goal + (state - goal) * keep
                held[k] = state
            return {"force_N": values["force_N"] - size * held}

        return HiddenError(
            lambda device: 0.1 * device.largest_force,
            ("force_N",),
            reading=reading,
            names=(),
            constants={"bristle": bristle, "slow": slow, "breakaway": more},
        )

    return Truth(build, "unseen")


def screw(law: Literal["sine", "two gears", "saw"]) -> Truth:
    """A leadscrew whose error comes back with every turn: no catalogue has it."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        low, high = device.actuator.sweep.distances_m[0], device.actuator.sweep.distances_m[-1]
        # Some turns within the travel: a finer screw is noise to a table of 8 to 24 distances
        turns, phase = float(rng.uniform(2.0, 5.0)), float(rng.uniform(0.0, 1.0))

        def wave(at: Conditions) -> FloatArray:
            x = turns * (at.distance - low) / (high - low) + phase
            if law == "saw":
                return 2.0 * (x % 1.0) - 1.0
            second = 0.5 * np.sin(2.0 * np.pi * 2.4 * x) if law == "two gears" else 0.0
            return np.asarray(np.sin(2.0 * np.pi * x) + second)

        return HiddenError(
            lambda device: 0.5 * device.largest_shift,
            ("force_N",),
            setting=lambda _, size, at: moved(at, size * wave(at)),
            names=(),
            constants={"pitch_m": (high - low) / turns},
        )

    return Truth(build, "unseen")
