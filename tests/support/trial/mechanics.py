"""Stops, springs, friction and screws: forces and places of which the field knows nothing."""

from dataclasses import replace

import numpy as np

from femfit.trial.field_table import HiddenError
from support.trial.truth import Truth, always, bent, needing, of_force, of_reading, place, travel


def stop(law):
    """Contact before the end: a round ``ball`` by Hertz (power 3/2), a ``flat`` stop, or ``rubber`` at the far end."""

    def build(device, rng):
        low, high = travel(device)
        reach = float(rng.uniform(0.1, 0.3)) * (high - low)

        def push(_, settings, __):
            far, near = settings.distance - (high - reach), low + reach - settings.distance
            x = np.maximum(0.0, far if law == "rubber" else near) / reach
            return {"ball": -(x**1.5), "flat": -x, "rubber": x * (1.0 + x)}[law]

        return of_reading("force_N", of_force(2.0), push, one_way=True)

    return Truth(build)


def spring(law):
    """A spring that is not drawn: ``straight``, ``conical`` and stiffer as it closes, or ``pretensioned``."""

    def build(device, rng):
        preload, free = (float(x) for x in rng.uniform([0.0, 0.6], [0.5, 0.9]))

        def pull(device, settings, _):  # what pushes the parts apart is a smaller attraction
            closed = 0.5 * (1.0 - place(device, settings))
            if law == "pretensioned":
                return -np.where(closed > 1.0 - free, closed - (1.0 - free) + preload, 0.0)
            return -(preload + closed * (1.0 + 0.2 * closed * (law == "conical")))

        return of_reading("force_N", of_force(0.5), pull, one_way=True)

    return Truth(build)


def carried_spring(bend):
    """A load cell that holds the body and so carries the drawn spring, which is not quite as drawn."""

    def pull(device, settings, _):
        push = np.asarray(device.actuator.mechanics.push_of_springs(settings.distance))
        return -push * bent(place(device, settings), bend)

    lacks = needing("spring", lambda drawn: drawn.mechanics.springs)
    return always(of_reading("force_N", 1.5, pull, one_way=True), lacks=lacks)


def friction(law):
    """Friction in the load cell's linkage, against the change of the force; no catalogue has it for a bench.

    The linkage gives way in proportion to the force. Dry friction (``coulomb``) turns with the direction; Stribeck's
    falls from its breakaway value as the steps grow; bristles (LuGre) bend first: df = (1 - f sign(dx) / g) dx / x_0.

    References
    ----------
    C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419.
    """

    def build(device, rng):
        bristle, slow, breakaway = (float(x) for x in rng.uniform([0.02, 0.01, 0.2], [0.2, 0.05, 1.0]))

        def form(device, settings, values):
            x = values["force_N"] / device.largest_force
            force, state = np.zeros(len(x)), 0.0
            for k in range(1, len(x)):
                if settings.run[k] != settings.run[k - 1]:
                    state = 0.0
                    continue
                step = float(x[k] - x[k - 1])
                level = 1.0 + breakaway * np.exp(-((step / slow) ** 2)) * (law != "coulomb")
                goal = np.sign(step) * level
                keep = np.exp(-abs(step) / (bristle * level)) if law == "lugre" else float(step == 0.0)
                state = goal + (state - goal) * keep
                force[k] = state
            return -force

        return of_reading("force_N", of_force(0.1), form, names=())

    return Truth(build, "unseen")


def screw(law):
    """A leadscrew whose error comes back with every turn, as a ``sine``, a ``saw`` or of ``two gears``: unseen."""

    def build(device, rng):
        low, high = travel(device)
        # Some turns within the travel: a finer screw is noise to a table of 8 to 24 distances
        turns, phase = float(rng.uniform(2.0, 5.0)), float(rng.uniform(0.0, 1.0))

        def setting(_, size, settings):
            x = turns * (settings.distance - low) / (high - low) + phase
            second = 0.5 * np.sin(2.0 * np.pi * 2.4 * x) * (law == "two gears")
            wave = 2.0 * (x % 1.0) - 1.0 if law == "saw" else np.sin(2.0 * np.pi * x) + second
            return replace(settings, distance=settings.distance + size * wave)

        return HiddenError(lambda device: 0.5 * device.largest_shift, ("force_N",), setting=setting, names=())

    return Truth(build, "unseen")
