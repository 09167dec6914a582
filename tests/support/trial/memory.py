"""Iron that remembers its currents: relays of Preisach, the law of Jiles and Atherton, and what stays for good.

References
----------
I. D. Mayergoyz, Mathematical Models of Hysteresis (Springer, 1991), chapter 1; D. C. Jiles and D. L. Atherton,
J. Magnetism and Magnetic Materials 61 (1986) 48.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from femfit.trial.field_table import HiddenError
from femfit.trial.hidden import is_linear_iron, is_soft
from support.trial.magnetics import magnetised_iron
from support.trial.truth import FIELD, Truth, always, bent, needing, place

REMANENCE_STEP_T = 0.02
"""Remanence of a linear core that is solved, either way; the fields are quadratic in it."""

_FAMILY = "memory"


def hysteresis(law):
    """A loop by ``jiles-atherton`` or ``normal`` or ``lorentzian relays``, demagnetised or cycled before each run."""

    def build(device, rng):
        coercive, second, third = (float(x) for x in rng.uniform([0.08, 0.2, 0.3], [0.25, 0.5, 0.6]))
        cycles = int(rng.choice([0, 3]))

        def remembered(history):
            x = history / device.largest_current
            if law == "jiles-atherton":
                return jiles_atherton(x, coercive, second, 0.2 * third)
            ensemble = relay_ensemble if law == "normal relays" else lorentzian_ensemble
            return ensemble(coercive, second, third).irreversible(x)

        def fields(device, size, settings):
            memory = np.empty(len(settings.current))
            for run in np.unique(settings.run):
                during = settings.current[settings.run == run]
                before = np.tile([during.max(), during.min()], cycles)
                memory[settings.run == run] = remembered(np.concatenate([before, during]))[len(before) :]
            return _magnetised(device, size * memory, settings)

        return HiddenError(_limit, FIELD, fields=fields)

    return Truth(build, lacks=_no_iron, families=_drawings)


def kept_flux(bend):
    """Iron that keeps a flux when the current is gone, by a tenth more or less over the distance."""

    def fields(device, size, settings):
        return _magnetised(device, size * bent(place(device, settings), bend), settings)

    return always(HiddenError(_limit, FIELD, fields=fields), lacks=_no_iron, families=_drawings)


def _magnetised(device, memory, settings):
    """What the memory of the core, -1 to 1 times its size, adds to the fields.

    Of a linear core a remanence in T, which is solved; of iron with a curve a part of the largest ampere-turns.
    """
    if _FAMILY in device.families:
        return device.change(_FAMILY, memory, settings)
    shifted = device.drawn.at(settings.distance, settings.current + device.largest_current * memory)
    return shifted - device.drawn.at(settings.distance, settings.current)


@dataclass(frozen=True, eq=False)
class Relays:
    """The classical Preisach model: relays with a centre and a half width each, arrays of shape (N,)."""

    centre: np.ndarray
    half: np.ndarray

    def output(self, history):
        """Magnetisation, -1..1, along a history that starts demagnetised; between its values it is monotonic."""
        up, down = self.centre + self.half, self.centre - self.half
        state = np.where(self.centre < 0.0, 1.0, -1.0)
        result = np.empty(len(history))
        for k, value in enumerate(history):
            state = np.where(value >= up, 1.0, np.where(value <= down, -1.0, state))
            result[k] = state.mean()
        return result

    def irreversible(self, history):
        """What hysteresis adds along a history to the anhysteretic magnetisation, where each centre decides."""
        return self.output(history) - np.sign(history[:, None] - self.centre).mean(axis=1)


def relay_ensemble(coercive, interaction, spread, count=24):
    """Relays with log-normal half widths, of median ``coercive``, and normal centres."""
    quantile = norm.ppf((np.arange(count) + 0.5) / count)
    centre, log_width = np.meshgrid(interaction * quantile, spread * quantile)
    return Relays(centre.ravel(), (coercive * np.exp(log_width)).ravel())


def lorentzian_ensemble(coercive, interaction, spread, count=24):
    """Relays whose half widths, mostly ``coercive``, and centres have the heavy tails of Lorentz's law."""
    quantile = np.tan(np.pi * ((np.arange(count) + 0.5) / count - 0.5))
    centre, width = np.meshgrid(0.5 * interaction * quantile, 0.3 * spread * quantile)
    return Relays(centre.ravel(), (coercive * np.maximum(1.0 + width, 0.05)).ravel())


def jiles_atherton(history, pinning, coupling, reversible):
    """What the magnetisation differs by from the anhysteretic one; shape parameter a = 0.5 of the input's unit.

    dM_irr/dH = (M_an - M_irr) / (k sign(dH) - alpha (M_an - M_irr)), not against the field, with
    M_an = coth(x) - 1/x, x = (H + alpha M_irr) / a; the difference is (1 - c) (M_irr - M_an).
    """
    shape, feedback = 0.5, 0.3 * coupling
    field = irreversible = 0.0
    result = np.empty(len(history))
    for n, goal in enumerate(history.tolist()):
        steps = max(1, math.ceil(abs(goal - field) / (0.25 * pinning)))
        change = (goal - field) / steps
        for _ in range(steps):
            field += change
            ahead = math.copysign(1.0, change) * (_langevin((field + feedback * irreversible) / shape) - irreversible)
            if ahead > 0.0:
                irreversible += change * ahead / max(pinning - feedback * ahead, 0.2 * pinning)
        anhysteretic = 0.0
        for _ in range(60):  # a contraction: feedback / (3 shape) < 0.1
            anhysteretic = _langevin((field + feedback * anhysteretic) / shape)
        result[n] = (1.0 - reversible) * (irreversible - anhysteretic)
    return result


def _langevin(x):
    return 1.0 / math.tanh(x) - 1.0 / x if abs(x) > 1e-4 else x / 3.0


def _limit(device):
    return 1.0 if _FAMILY in device.families else 0.025


_no_iron = needing("iron that stands still", lambda drawn: any(map(is_soft, drawn.fixed)))


def _drawings(actuator):
    """A linear core with the remanence that the winding's flux leaves in it, positive where it adds to that flux.

    Along the axis within the winding and against it outside of it, where the flux returns; parts above and below the
    winding lead it outwards and are left as they are.
    """
    if not all(map(is_linear_iron, filter(is_soft, actuator.regions))):
        return {}
    winding_r, winding_z = np.array(actuator.coil.vertices_m).T

    def way(region):
        r, z = np.array(region.vertices_m).T
        if z.max() <= winding_z.min() or z.min() >= winding_z.max():
            return 0.0
        return -1.0 if r.min() >= winding_r.max() else 1.0

    return {_FAMILY: {step: magnetised_iron(actuator, step, way) for step in (-REMANENCE_STEP_T, REMANENCE_STEP_T)}}
