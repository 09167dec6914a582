r"""What the numbers of a drawing change of an impedance beside W'(d, i), as splines of the model.

With dL/dp by the field at frequencies, and dL_0/dp by the number's own change of W', a model in which L(f) = g(f) L_0
follows a small current has g^2 dL_0/dp already. Between frequencies the rest's ratio to g^2 is followed, which varies
less than the rest dL/dp - g^2 dL_0/dp itself.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.device.drawn_numbers import NumberFacts
from femfit.fit.constants import EDDY_PER_DECADE
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
    if slopes is None or eddy is None or slopes.slopes.shape[-1] != 1:
        return tuple(drawn)
    order = np.argsort(slopes.distances_m)
    distance, frequency = slopes.distances_m[order], spline_frequencies(slopes.frequencies_Hz)
    inductance = magnetics.inductance(distance, np.zeros_like(distance))
    follows = _following(inductance, distance, frequency, eddy)
    at_probes = _following(inductance, distance, slopes.frequencies_Hz, eddy)
    known, found = {one.key: one for one in drawn}, list(drawn)
    for number, by_number in zip(slopes.numbers, slopes.slopes[..., 0, 0][:, order], strict=True):
        if number.effect or number.kind == CONDUCTIVITY or not by_number.any():
            continue
        one = known.get(number.key) or _without_terms(number)
        ratio = by_number / at_probes**2 - _static(one, distance)[:, None]
        rest = follows**2 * _along(np.log(slopes.frequencies_Hz), ratio, np.log(frequency))
        change = impedance_change(
            one.parameter,
            eddy.coordinate,
            distance,
            np.zeros(1),
            frequency,
            2j * np.pi * frequency * rest[:, None],
            share=not one.unit,
        )
        changed = replace(one, impedance=change)
        found = [changed if other is one else other for other in found] if number.key in known else [*found, changed]
    return tuple(found)


def _without_terms(number: NumberFacts) -> DrawnEffect:
    return DrawnEffect(number.key, number.also, number.subject, number.value, number.unit, number.tolerance, ())


def _following(inductance: FloatArray, distance: FloatArray, frequency: FloatArray, eddy: EddyCurrents) -> ComplexArray:
    """The share g at distances and frequencies, shape (d, f)."""
    at = np.broadcast_to(distance[:, None], (len(distance), len(frequency)))
    alone, share = inductance[:, None, None, None], np.ones_like(at, dtype=np.complex128)
    induced = induced_impedance(alone, frequency, share, eddy, at)[..., 0, 0]
    return np.asarray(induced / (2j * np.pi * frequency * inductance[:, None]))


def _static(drawn: DrawnEffect, distance: FloatArray) -> FloatArray:
    """d^2(dW'/dp)/di^2 of a number without a current, in H per unit."""
    still, result = np.zeros_like(distance), np.zeros_like(distance)
    for term in drawn.terms:
        if term.coenergy is not None:
            result += term.coordinate.partial_derivatives(term.coenergy, distance, still, ((0, 2),))[0]
    return result


def spline_frequencies(frequency: FloatArray) -> FloatArray:
    """Frequencies over the range of others, as near as the splines of an impedance's change need them."""
    low, high = frequency[[0, -1]]
    return np.geomspace(low, high, 1 + max(CUBIC, round(EDDY_PER_DECADE * np.log10(high / low))))


def _along(x: FloatArray, values: ComplexArray, at: FloatArray) -> ComplexArray:
    """Values (d, x) interpolated at other places of x."""
    return np.asarray(make_interp_spline(x, values, k=min(CUBIC, len(x) - 1), axis=1)(at))
