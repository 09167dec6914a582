"""What the numbers of a drawing change, as splines of the model: its own basis, fitted to slopes in place of values.

What the numbers of a drawing change of an impedance beside W'(d, i), as splines of the model.

With dL/dp by the field at frequencies, and dL_0/dp by the number's own change of W', a model of n circuits in which
L(f) = g(f) L_0 follows small currents has g dL_0/dp g^T already, since L^-1 - L_0^-1 is of the eddy currents alone.
Between frequencies g^-1 (dL/dp) g^-T is followed, which varies less than dL/dp itself.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.interpolate import make_interp_spline

from femfit.core.numerics import BoolArray, ComplexArray, FloatArray
from femfit.core.sweep_columns import is_current
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.tolerances import KINDS
from femfit.fit.coenergy import CoenergyFit, with_coefficients
from femfit.fit.coenergy_system import coenergy_system
from femfit.fit.constants import AT_THE_GAP, EDDY_PER_DECADE
from femfit.fit.rows import FitRows, rms
from femfit.fit.sensed_field import HallFit
from femfit.model.carried import FieldTerm
from femfit.model.drawn_effect import DrawnEffect, parameter_name
from femfit.model.eddy_currents import EddyCurrents
from femfit.model.impedance import CUBIC, impedance_change, induced_impedance
from femfit.model.magnetics import Magnetics
from femfit.tables.signatures import ImpedanceSlopes, Signatures


def drawn_effects(
    signatures: Signatures | None, rows: FitRows, coenergy: CoenergyFit | None, hall: HallFit | None
) -> tuple[DrawnEffect, ...]:
    """The numbers of the drawing with their splines; none where the table is too small for a co-energy.

    A number that changes nothing at the points of the sweep is left out.
    """
    if signatures is None or coenergy is None:
        return ()
    with_slopes, slopes = _aligned(signatures, rows)
    acting = [k for k, fact in enumerate(signatures.numbers) if np.any(slopes[:, :, k]) and not fact.effect]
    numbers, slopes = [signatures.numbers[k] for k in acting], slopes[:, :, acting]
    rows = rows.take(with_slopes)
    of_fields = 1 if rows.flux_linkage is None else 2
    magnetic = coenergy_system(rows).without_constraints(coenergy.basis, slopes[:of_fields])
    field = None
    if hall is not None and len(slopes) > 2:
        field, columns = hall.field, hall.basis.columns(rows.distance, rows.circuit_currents)
        sensed = np.linalg.lstsq(columns, slopes[2], rcond=1e-12)[0]
    effects = []
    for k, number in enumerate(numbers):
        name, reciprocal, terms = parameter_name(number.unit), KINDS[number.kind].reciprocal, list[FieldTerm]()
        if np.any(magnetic[:, k]):
            change = with_coefficients(coenergy.magnetics, magnetic[:, k])
            terms.append(FieldTerm(name, coenergy=change, reciprocal=reciprocal))
        if field is not None:
            terms.append(FieldTerm(name, hall=with_coefficients(field, sensed[:, k]), reciprocal=reciprocal))
        gap_m = _gap(number, coenergy, rows, slopes[:of_fields, :, k])
        effects.append(replace(drawn_effect(number, tuple(terms)), gap_m=gap_m))
    return tuple(effects)


def drawn_effect(number: NumberFacts, terms: tuple[FieldTerm, ...], *, at_rest: bool = False) -> DrawnEffect:
    """A number with what it changes."""
    names = "key", "also", "subject", "value", "unit", "tolerance", "stands_for"
    return DrawnEffect(**{name: getattr(number, name) for name in names}, terms=terms, at_rest=at_rest)


def _aligned(signatures: Signatures, rows: FitRows) -> tuple[BoolArray, FloatArray]:
    """Which rows of the fit have slopes, and these; shape (channels, rows with slopes, numbers)."""
    current = next(name for name in map(str, signatures.rows) if is_current(name))
    channels = [name for name in ("force_N", "flux_linkage_Wb", "hall_T") if name in signatures.rows]
    grid = pd.MultiIndex.from_arrays([rows.distance, rows.current])
    tables = [
        signatures.of(number).set_index(["distance_m", current])[channels].reindex(grid)
        for number in signatures.numbers
    ]
    slopes = np.stack([table.to_numpy().T for table in tables], axis=2)
    complete = np.isfinite(slopes).all(axis=(0, 2))
    return complete, slopes[:, complete]


def _gap(number: NumberFacts, coenergy: CoenergyFit, rows: FitRows, slopes: FloatArray) -> float:
    """By how much a unit of a number shortens the distance, in m; zero of one that acts otherwise as well.

    The force and the flux linkage count by their slopes along the distance.
    """
    fitted = coenergy.magnetics.slopes(rows.distance, rows.circuit_currents)
    along = [-fitted.force_gradient, fitted.motional_constant[:, 0]]
    size = np.array([rms(column) or 1.0 for column in along[: len(slopes)]])[:, None]
    nearer, changed = np.array(along[: len(slopes)]) / size, slopes / size
    gap = float(np.sum(nearer * changed) / np.sum(nearer**2))
    remainder = rms((changed - gap * nearer).ravel())
    return gap if number.kind == "length" and remainder < AT_THE_GAP * rms(changed.ravel()) else 0.0


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
    inductance = magnetics.state(distance, np.zeros((len(distance), len(eddy.circuits)))).inductance
    follows = _following(inductance, distance, frequency, eddy)
    at_probes = _following(inductance, distance, slopes.frequencies_Hz, eddy)
    before = np.asarray(np.linalg.inv(at_probes), dtype=np.complex128)
    effects, probed = {effect.key: effect for effect in drawn}, np.log(slopes.frequencies_Hz)
    for number, by_number in zip(slopes.numbers, slopes.slopes[:, order], strict=True):
        if number.effect or number.kind == CONDUCTIVITY or not by_number.any():
            continue
        effect = effects.get(number.key) or drawn_effect(number, (), at_rest=KINDS[number.kind].at_rest)
        ratio = _turned(before, by_number) - _static(effect, distance)[:, None, None, None]
        between = make_interp_spline(probed, ratio, k=min(CUBIC, len(probed) - 1), axis=1)
        remaining = _turned(follows, between(np.log(frequency)))
        change = impedance_change(
            effect.parameter,
            eddy.coordinate,
            distance,
            np.zeros(1),
            frequency,
            2j * np.pi * frequency[:, None, None] * remaining[:, None],
            share=not effect.unit,
        )
        effects[number.key] = replace(effect, impedance=change)
    return tuple(effects.values())


def _following(inductance: FloatArray, distance: FloatArray, frequency: FloatArray, eddy: EddyCurrents) -> ComplexArray:
    """The share g at distances and frequencies, shape (d, f, n, n)."""
    (forms,) = eddy.forms(np.broadcast_to(distance[:, None], (len(distance), len(frequency))))
    alone = inductance[:, None]
    induced = induced_impedance(alone, 2j * np.pi * frequency, 1.0, forms)
    return np.asarray(induced @ np.linalg.inv(alone) / (2j * np.pi * frequency[:, None, None]))


def _turned(g: ComplexArray, inductance: ComplexArray) -> ComplexArray:
    """G L G^T."""
    return np.asarray(g @ inductance @ np.swapaxes(g, -1, -2))


def _static(drawn: DrawnEffect, distance: FloatArray) -> FloatArray:
    """d^2(dW'/dp)/di^2 of a number without a current, in H per unit; of one circuit, which alone has such terms."""
    still = np.zeros((len(distance), 1))
    changes = [term.coenergy.inductance(distance, still)[:, 0, 0] for term in drawn.terms if term.coenergy is not None]
    return sum(changes, np.zeros_like(distance))


def spline_frequencies(frequency: FloatArray) -> FloatArray:
    """Frequencies over the range of others, as near as the splines of an impedance's change need them."""
    low, high = frequency[[0, -1]]
    if low == high:
        return frequency[:1]
    return np.geomspace(low, high, 1 + max(CUBIC, round(EDDY_PER_DECADE * np.log10(high / low))))
