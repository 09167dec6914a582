"""What no effect explains, learnt as one smooth bounded change of W'(d, i), and where that pays of one sensor.

How large and how smooth each is follows from the restricted likelihood of penalised splines. Whitened readings are
y = X beta + noise with beta ~ N(0, t^2 K). K is the correlation of a smooth function, so that 1 / t^2 is the penalty on
what is large or rough. With Phi = X t K^(1/2) and the likelihood without a remainder as the unit,

    log p = (z'z - log det(I + Phi'Phi)) / 2,    z = (I + Phi'Phi)^(-1/2) Phi'y.

Nothing beside the penalised coefficients is fitted, so that restricted likelihood and likelihood are one.

References
----------
S. N. Wood, Journal of the Royal Statistical Society B 73 (2011) 3: smoothing by restricted likelihood.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from femfit.core.errors import MissingPartError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.identify.bench import placed
from femfit.identify.decision.campaign import Block
from femfit.identify.decision.evidence import Linear, LogDensity
from femfit.identify.left_out import cross_validated
from femfit.identify.noise.components import beside_effects
from femfit.identify.noise.whitening import Whitening, orthonormal_basis
from femfit.identify.observations import Observations
from femfit.identify.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.bspline import DistanceCoordinate, TensorSpline
from femfit.model.carried import Carried, Curve, FieldTerm, bounded_basis
from femfit.model.magnetics import CoenergySpline
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement, channel_words

PRICE = 4.5
"""Conventional: log evidence that a part must add, as three deviations of one number would (9 in chi-square)."""

SPLINE_DEGREE = 4
"""Derived: force gradients and inductance gradients, third derivatives of W', are continuous with quartic splines."""

FIELD_CELLS, CURVE_CELLS = (12, 3), 8
"""Numerical: cells of a function of distance and current, and of a curve. Smoothness is chosen by the data; these are
the finest that it can be."""

FIELD_SCALES, CURVE_SCALES = ((0.05, 0.15, 0.4), (0.6, 1.8, 6.0)), (0.15, 0.6)
"""Numerical: correlation lengths that are tried, over the range of the data; the longest is next to a straight line."""

JITTER = 1e-8
"""Numerical: added to the correlation of a coefficient with itself, so that its root exists."""

REMAINDER_SIZES = 50
"""Numerical: sizes of a part that are tried, from a tenth of the noise to 1e4 times as much."""


NAME = "unexplained"
"""What the remainder is called as an effect; no cause is."""

COENERGY = "coenergy"
READINGS = ("force_N", "flux_linkage_Wb", "hall_V")
PARTS = {COENERGY: "a change of the co-energy over distance and current (force and flux linkage together)"} | {
    name: f"an error of the {channel_words(name)} over its own value" for name in READINGS
}
"""What a remainder may change."""


@dataclass(frozen=True, eq=False)
class Axis:
    """A bounded spline over one variable."""

    knots: FloatArray
    degree: int
    expand: FloatArray  # From free coefficients to all
    roots: Sequence[FloatArray]  # Of the prior covariances of the free coefficients that are tried, L L' = K

    @classmethod
    def over(cls, values: FloatArray, cells: int, scales: Sequence[float]) -> "Axis | None":
        """Over the range of values; None where there is none.

        K falls like a bell curve with the distance of the coefficients: fields are smooth to all orders.
        """
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if not high - low > 1e-9 * max(abs(low), abs(high)):
            return None
        knots, expand = bounded_basis(low, high, cells, SPLINE_DEGREE)
        place = np.arange(expand.shape[1]) / cells
        apart = place[:, None] - place
        unit = JITTER * np.eye(len(place))
        roots = [np.asarray(np.linalg.cholesky(np.exp(-0.5 * (apart / scale) ** 2) + unit)) for scale in scales]
        return cls(knots, SPLINE_DEGREE, expand, roots)


@dataclass(frozen=True, eq=False)
class Part:
    """What a remainder may change: W' over distance and current, or a channel's readings over their own value."""

    kind: str
    axes: tuple[Axis, ...]
    step: float  # Of a coefficient, for differences
    coordinate: DistanceCoordinate  # Of the distance

    @cached_property
    def roots(self) -> list[FloatArray]:
        """Roots of the prior covariances that are tried, each of shape (count, count)."""
        first, *second = (axis.roots for axis in self.axes)
        return list(first) if not second else [np.asarray(np.kron(a, b)) for a in first for b in second[0]]

    def carried(self, free: FloatArray) -> Carried:
        """What it changes with these coefficients."""
        axis, *second = self.axes
        if not second:
            return Carried(readings={self.kind: Curve("share", axis.knots, axis.degree, axis.expand @ free)})
        of_current = second[0]
        every = axis.expand @ free.reshape(axis.expand.shape[1], -1) @ of_current.expand.T
        spline = TensorSpline(axis.knots, of_current.knots, axis.degree, of_current.degree, every)
        return Carried((FieldTerm("share", coenergy=CoenergySpline(self.coordinate, spline)),))


def parts_of(observations: Observations) -> list[Part]:
    """The parts that these readings could show."""
    nominal, table, result = observations.nominal, observations.covariates, list[Part]()
    d, i = table["distance_m"].to_numpy(), table["current_A"].to_numpy()
    plain_distance = DistanceCoordinate(1.0, kind="distance")
    coordinate = DistanceCoordinate(float(d.max()), 0.0) if d.min() > 0.2 * np.ptp(d) else plain_distance
    along = Axis.over(coordinate.of(d), FIELD_CELLS[0], FIELD_SCALES[0])
    still = Axis(np.array([i[0] - 1.0, i[0] + 1.0]), 0, np.ones((1, 1)), [np.ones((1, 1))])  # without a current to vary
    energy = nominal.force_N * nominal.travel_m
    if along is not None and energy > 0.0:
        across = Axis.over(i, FIELD_CELLS[1], FIELD_SCALES[1]) or still
        result.append(Part(COENERGY, (along, across), 1e-4 * energy, coordinate))
    for name in (name for name in READINGS if name in observations.channels):
        values = observations.value[observations.of(name)]
        axis = Axis.over(values, CURVE_CELLS, CURVE_SCALES)
        if axis is not None:
            result.append(Part(name, (axis,), 1e-4 * float(np.abs(values).max()), plain_distance))
    return result


def effect_of(parts: Sequence[Part], coefficients: Sequence[FloatArray]) -> AddedEffect:
    """The effect that parts with their coefficients are."""
    each = [part.carried(free) for part, free in zip(parts, coefficients, strict=True)]
    terms = tuple(term for changes in each for term in changes.magnetics or ())
    readings = {name: curve for changes in each for name, curve in changes.readings.items()}
    share = EffectParameter(
        "share",
        bounds=(0.0, 2.0),
        plausible=(0.0, 1.0),
        description="How much of what was learnt acts.",
        words=f"of no known cause; {' and '.join(PARTS[part.kind] for part in parts)}",
    )
    symptom = "The readings depart smoothly from the model, as no effect of the catalogue makes them."
    carried = Carried(magnetics=terms or None, readings=readings)
    return AddedEffect(carried.effect(NAME, symptom, (share,)), {"share": 1.0})


def columns_of(observations: Observations, part: Part) -> FloatArray:
    """Change of every reading with each coefficient of a part, in which readings are linear; shape (M, count)."""
    changes = [
        observations.predict([effect_of([part], [part.step * unit])]) - observations.base
        for unit in np.eye(len(part.roots[0]))
    ]
    return np.stack(changes, axis=1) / part.step


@dataclass(frozen=True, eq=False)
class Learnt:
    """A remainder: what it changes, and as an effect; empty where nothing pays."""

    kinds: tuple[str, ...] = ()
    effects: tuple[AddedEffect, ...] = ()
    decided: FloatArray | None = None  # Whitened directions that readings decided more than the penalty; shape (M, k)


def learn(
    whitening: Whitening, parts: Sequence[Part], columns: Sequence[FloatArray], named: FloatArray | None = None
) -> Learnt:
    """The part of largest evidence, then the field beside a sensor or a sensor beside the field, each at its price.

    Parameters
    ----------
    columns : sequence of array
        Change of every reading with each coefficient, for each part.
    named : array, shape (M, q), or None
        Change of every reading with the parameters of effects beside it: what these can explain is left to them.
    """
    basis = orthonormal_basis(whitening.full(np.zeros((len(columns[0]), 0)) if named is None else named))

    def white(x: FloatArray) -> FloatArray:
        whitened = whitening.full(x)
        return np.asarray(whitened - basis @ (basis.T @ whitened))

    blocks, chosen, roots = [white(block) for block in columns], list[int](), list[FloatArray]()
    linear = given(white(whitening.observations.residual), [], [])
    while len(chosen) < 2:
        with_field = COENERGY in {parts[k].kind for k in chosen}
        candidates = [k for k in range(len(parts)) if not chosen or (parts[k].kind == COENERGY) != with_field]
        if not candidates:
            break
        tries = [(*likeliest_root(linear, blocks[k], parts[k].roots), k) for k in candidates]
        log_evidence, root, best = max(tries, key=lambda candidate: candidate[0])
        if log_evidence <= linear.log_evidence + PRICE:
            break
        chosen, roots = [*chosen, best], [*roots, root]
        linear = given(linear.target, [blocks[k] for k in chosen], roots)
    if not chosen:
        return Learnt()
    ends = np.cumsum([len(root) for root in roots])[:-1]
    coefficients = np.split(linalg.block_diag(*roots) @ linear.amplitudes, ends)
    some = [parts[k] for k in chosen]
    directions, size, _ = np.linalg.svd(linear.columns, full_matrices=False)
    return Learnt(tuple(part.kind for part in some), (effect_of(some, coefficients),), directions[:, size > 1.0])


def given(target: FloatArray, blocks: Sequence[FloatArray], roots: Sequence[FloatArray]) -> Linear:
    """Whitened readings (M,) with coefficients of columns (M, count) known to N(0, L L')."""
    scaled = [block @ root for block, root in zip(blocks, roots, strict=True)]
    columns = np.concatenate([np.zeros((len(target), 0)), *scaled], axis=1)
    return Linear.of(target, columns, LogDensity(len(target), np.inf))


def likeliest_root(beside: Linear, block: FloatArray, tried: Sequence[FloatArray]) -> tuple[float, FloatArray]:
    """The largest log evidence with further columns (M, count), and the root of their covariance, times its size."""
    gram, along = beside.products(Block(block))
    best = -np.inf, tried[0]
    for root in tried:
        inner = root.T @ gram @ root
        largest = max(float(np.linalg.eigvalsh(inner)[-1]), 1e-300)
        sizes = np.geomspace(0.1, 1e4, REMAINDER_SIZES) / np.sqrt(largest)
        logs = beside.with_more(inner, root.T @ along, sizes)[0]
        best = max(best, (float(logs.max()), sizes[int(np.argmax(logs))] * root), key=lambda pair: pair[0])
    return best


def learn_remainder(
    model: ActuatorModel, measured: Measurement, whitening: Whitening, named: Collection[str] = ()
) -> tuple[Learnt, Whitening, dict[str, float], float]:
    """Learn what a model with all its effects leaves of the readings, and check it on runs left out.

    Parameters
    ----------
    whitening : Whitening
        Of the readings beside this model.
    named : collection of str
        Effects of the model that are fitted to the same readings: what they can explain is left to them.

    Returns
    -------
    tuple of (Learnt, Whitening, dict of str to float, float)
        What was learnt; the readings with the noise beside it; on runs left out the error per channel, and by how much
        the weighted sum of squares falls.
    """
    if len(model.without_effects.validity.current_limits_A) > 1:
        raise MissingPartError(sentence("refusals", "several_circuits", model))
    observations = whitening.observations
    staying = [present for present in model.effects if present.effect.name not in named]
    fitted = [present for present in model.effects if present.effect.name in named]
    numbers = [(k, p.name) for k, present in enumerate(fitted) for p in present.effect.parameters]
    by_names = placed(with_effects(model, staying), measured).predicted(fitted, numbers)[:, 1:]
    parts = parts_of(observations)
    columns = [columns_of(observations, part) for part in parts]
    learnt = learn(whitening, parts, columns, by_names) if parts else Learnt()
    if learnt.effects:
        whitening = Whitening(observations, beside_effects(whitening, learnt.effects).noise)
        learnt = learn(whitening, parts, columns, by_names)

    def learnt_from(keep: BoolArray) -> tuple[AddedEffect, ...]:
        """The same without some readings, choice and smoothness too."""
        some = Whitening(observations.select(keep), whitening.noise)
        return learn(some, parts, [block[keep] for block in columns], by_names[keep]).effects

    left_out, before = cross_validated(whitening, lambda _: ())
    left_out, chi2 = cross_validated(whitening, learnt_from) if learnt.effects else (left_out, before)
    return learnt, whitening, left_out, before - chi2
