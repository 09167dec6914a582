r"""What the numbers of a drawing change of an impedance beside W'(d, i), as splines of the model.

With dL/dp by the field at frequencies, and dL_0/dp by the number's own change of W', a model of n circuits in which
L(f) = g(f) L_0 follows small currents has g dL_0/dp g^T already, since L^-1 - L_0^-1 is of the eddy currents alone.
Between frequencies g^-1 (dL/dp) g^-T is followed, which varies less than dL/dp itself.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.device.tolerance_defaults import KINDS
from femfit.fit.constants import EDDY_PER_DECADE
from femfit.fit.drawing import drawn_effect
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.eddy_currents import EddyCurrents
from femfit.model.impedance import induced_impedance
from femfit.model.impedance_change import CUBIC, impedance_change
from femfit.model.magnetics import Magnetics
from femfit.tables.impedance_slopes import ImpedanceSlopes

CONDUCTIVITY = "conductivity"
"""The kind of number whose slopes the sweep's patterns give at every distance (:mod:`femfit.fit.eddy`)."""


def with_impedances(
    drawn: Sequence[DrawnEffect], slopes: ImpedanceSlopes | None, magnetics: Magnetics, eddy: EddyCurrents | None
) -> tuple[DrawnEffect, ...]:
    """The drawing's numbers with what they change of the impedance, and those that change nothing else."""
    if slopes is None or eddy is None or not eddy.circuits:
        return tuple(drawn)
    order = np.argsort(slopes.distances_m)
    distance, frequency = slopes.distances_m[order], spline_frequencies(slopes.frequencies_Hz)
    inductance = magnetics.state_of_circuits(distance, np.zeros((len(distance), len(eddy.circuits)))).inductance
    follows = _following(inductance, distance, frequency, eddy)
    at_probes = _following(inductance, distance, slopes.frequencies_Hz, eddy)
    before = np.asarray(np.linalg.inv(at_probes), dtype=np.complex128)
    by_key, effects = {effect.key: effect for effect in drawn}, list(drawn)
    for number, by_number in zip(slopes.numbers, slopes.slopes[:, order], strict=True):
        if number.effect or number.kind == CONDUCTIVITY or not by_number.any():
            continue
        effect = by_key.get(number.key) or drawn_effect(number, (), at_rest=KINDS[number.kind].at_rest)
        ratio = _turned(before, by_number) - _static(effect, distance)[:, None, None, None]
        rest = _turned(follows, _along(np.log(slopes.frequencies_Hz), ratio, np.log(frequency)))
        change = impedance_change(
            effect.parameter,
            eddy.coordinate,
            distance,
            np.zeros(1),
            frequency,
            2j * np.pi * frequency[:, None, None] * rest[:, None],
            share=not effect.unit,
        )
        changed = replace(effect, impedance=change)
        effects = (
            [changed if earlier is effect else earlier for earlier in effects]
            if number.key in by_key
            else [*effects, changed]
        )
    return tuple(effects)


def _following(inductance: FloatArray, distance: FloatArray, frequency: FloatArray, eddy: EddyCurrents) -> ComplexArray:
    """The share g at distances and frequencies, shape (d, f, n, n)."""
    at_each = np.broadcast_to(distance[:, None], (len(distance), len(frequency)))
    alone, share = inductance[:, None], np.ones_like(at_each, dtype=np.complex128)
    induced = induced_impedance(alone, frequency, share, eddy, at_each)
    return np.asarray(induced @ np.linalg.inv(alone) / (2j * np.pi * frequency[:, None, None]))


def _turned(g: ComplexArray, inductance: ComplexArray) -> ComplexArray:
    """G L G^T."""
    return np.asarray(g @ inductance @ np.swapaxes(g, -1, -2))


def _static(drawn: DrawnEffect, distance: FloatArray) -> FloatArray:
    """d^2(dW'/dp)/di^2 of a number without a current, in H per unit; of one circuit, which alone has such terms."""
    still, result = np.zeros_like(distance), np.zeros_like(distance)
    for term in drawn.terms:
        if term.coenergy is not None:
            result += term.coordinate.partial_derivatives(term.coenergy, distance, still, ((0, 2),))[0]
    return result


def spline_frequencies(frequency: FloatArray) -> FloatArray:
    """Frequencies over the range of others, as near as the splines of an impedance's change need them."""
    low, high = frequency[[0, -1]]
    if low == high:
        return frequency[:1]
    return np.geomspace(low, high, 1 + max(CUBIC, round(EDDY_PER_DECADE * np.log10(high / low))))


def _along(x: FloatArray, values: ComplexArray, places: FloatArray) -> ComplexArray:
    """Values (d, x) interpolated at other places of x."""
    return np.asarray(make_interp_spline(x, values, k=min(CUBIC, len(x) - 1), axis=1)(places))
