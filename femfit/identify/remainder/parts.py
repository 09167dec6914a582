"""The parts that a remainder may have: where each acts, over what, and as which bounded spline."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.identify.observations import Observations
from femfit.identify.remainder.constants import (
    CURVE_CELLS,
    CURVE_SCALES,
    DEGREE,
    DISTANCE_CELLS,
    DISTANCE_SCALES,
    FIELD_CELLS,
    FIELD_SCALES,
    JITTER,
    LINEAR_STEP,
    PART_OF_MOST,
)
from femfit.identify.series.balances import FORCE_BALANCE
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.carried import (
    Brake,
    Carried,
    Curve,
    FieldTerm,
    bounded_basis,
    carried_effect,
)
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.hall import HallSpline
from femfit.model.magnetics import CoenergySpline
from femfit.tables.measurement import CHANNEL_WORDS

NAME = "unexplained"
"""What the remainder is called as an effect; no cause is."""

COENERGY, HALL_FIELD = "coenergy", "hall_field"
BRAKE, RESISTANCE, FORCE_BRANCH = "brake", "resistance", "force_branch"
SETTINGS = ("distance_m", "current_A")
READINGS = ("force_N", "flux_linkage_Wb", "hall_V")

UNITS = {COENERGY: "J", HALL_FIELD: "T", BRAKE: "N", RESISTANCE: "ohm", FORCE_BRANCH: "N"} | {
    name: name.rpartition("_")[2] for name in (*SETTINGS, *READINGS)
}

WORDS = {
    COENERGY: "a change of the co-energy over distance and current (force and flux linkage together)",
    HALL_FIELD: "a change of the field at the Hall element over distance and current",
    BRAKE: "a brake over the speed",
    RESISTANCE: "a resistance over the current",
    FORCE_BRANCH: "an error of the force over its own value that turns with the branch of the current",
    "distance_m": "an error of the recorded distance over the distance",
    "current_A": "an error of the recorded current over the current",
} | {name: f"an error of the {CHANNEL_WORDS[name]} over its own value" for name in READINGS}

SHARE = "share"
_SHARE = EffectParameter(
    SHARE,
    bounds=(0.0, 2.0),
    plausible=(0.0, 1.0),
    description="How much of what was learnt acts.",
)


@dataclass(frozen=True, eq=False)
class Axis:
    """One variable of a part: the bounded spline over it."""

    low: float
    high: float
    knots: FloatArray
    degree: int
    expand: FloatArray  # From free coefficients to all
    scales: tuple[float, ...]  # Correlation lengths that are tried, over the range

    @property
    def count(self) -> int:
        """Free coefficients."""
        return int(self.expand.shape[1])

    def roots(self) -> list[FloatArray]:
        """For each correlation length a root L of the prior covariance of the free coefficients, L L' = K.

        K falls like a bell curve with the distance of the coefficients: fields are smooth to all orders.
        """
        places = (np.convolve(self.knots[1:-1], np.ones(self.degree), "valid") / self.degree) if self.degree else [0.0]
        place = np.asarray(places)[self.degree : self.degree + self.count]
        apart = np.abs(place[:, None] - place) / max(self.high - self.low, 1e-300)
        return [
            np.linalg.cholesky(np.exp(-0.5 * (apart / scale) ** 2) + JITTER * np.eye(self.count))
            for scale in self.scales
        ]

    def rows(self, x: FloatArray) -> FloatArray:
        """The free functions at points, shape (n, count)."""
        inside = np.clip(x, self.knots[0], self.knots[-1])
        return np.asarray(basis_matrix(inside, self.knots, self.degree) @ self.expand)


@dataclass(frozen=True, eq=False)
class Part:
    """A part that a remainder may have."""

    kind: str
    axes: tuple[Axis, ...]
    step: float  # Of a coefficient, for differences
    coordinate: DistanceCoordinate  # Of its first axis, where that is the distance of a field

    @property
    def count(self) -> int:
        """Free coefficients."""
        return int(np.prod([axis.count for axis in self.axes]))

    @property
    def bends(self) -> bool:
        """Whether the readings are not linear in it."""
        return self.kind in SETTINGS

    @cached_property
    def roots(self) -> list[FloatArray]:
        """Roots of the prior covariances that are tried, each of shape (count, count)."""
        first, *second = (axis.roots() for axis in self.axes)
        return first if not second else [np.asarray(np.kron(a, b)) for a in first for b in second[0]]

    def rows(self, *x: FloatArray) -> FloatArray:
        """The free functions at points of its variables, the first in its coordinate, shape (n, count)."""
        each = [axis.rows(values) for axis, values in zip(self.axes, x, strict=True)]
        return each[0] if len(each) == 1 else np.asarray(np.einsum("ni,nj->nij", *each).reshape(len(x[0]), -1))

    def curve(self, coefficients: FloatArray) -> Curve:
        """As a curve, of a single axis."""
        axis = self.axes[0]
        return Curve(SHARE, axis.knots, axis.degree, axis.expand @ coefficients)

    def term(self, coefficients: FloatArray) -> FieldTerm:
        """As a change of the field, of two axes."""
        d, i = self.axes
        every = d.expand @ coefficients.reshape(d.count, i.count) @ i.expand.T
        spline = TensorSpline(d.knots, i.knots, d.degree, i.degree, every)
        if self.kind == COENERGY:
            return FieldTerm(SHARE, coenergy=CoenergySpline(self.coordinate, spline))
        return FieldTerm(SHARE, hall=HallSpline(self.coordinate, spline))


def effect_of(
    coefficients: Mapping[Part, FloatArray], words: str = "", notes: Mapping[str, str] | None = None
) -> AddedEffect:
    """The whole of the effect that parts with their coefficients are."""
    of = {part.kind: (part, free) for part, free in coefficients.items()}
    terms = tuple(part.term(free) for kind, (part, free) in of.items() if kind in {COENERGY, HALL_FIELD})
    curves = {kind: part.curve(free) for kind, (part, free) in of.items() if kind not in {COENERGY, HALL_FIELD}}
    carried = Carried(
        magnetics=terms or None,
        setting={name: curves[name] for name in SETTINGS if name in curves},
        readings={name: curves[name] for name in READINGS if name in curves},
        branches={"force_N": curves[FORCE_BRANCH]} if FORCE_BRANCH in curves else {},
        brake=Brake(PART_OF_MOST * of[BRAKE][0].axes[0].high, curves[BRAKE]) if BRAKE in curves else None,
        resistance=curves.get(RESISTANCE),
        notes=notes or {},
    )
    share = EffectParameter(**{**vars(_SHARE), "words": words})
    symptom = "The readings depart smoothly from the model, as no effect of the catalogue makes them."
    return AddedEffect(carried_effect(NAME, symptom, (share,), carried), {SHARE: 1.0})


def parts_of(observations: Observations) -> list[Part]:
    """The parts that these readings could show."""
    nominal, table, channels = observations.nominal, observations.covariates, observations.channels
    d, i = table["distance_m"].to_numpy(), table["current_A"].to_numpy()
    result: list[Part] = []

    def add(kind: str, axes: Sequence[Axis | None], size: float, coordinate: DistanceCoordinate = _PLAIN) -> None:
        varying = [axis for axis in axes if axis is not None]
        if len(varying) == len(axes) and np.isfinite(size) and size > 0.0:
            result.append(Part(kind, tuple(varying), LINEAR_STEP * size, coordinate))

    field_of = DistanceCoordinate(float(d.max()), 0.0) if d.min() > 0.2 * np.ptp(d) else _PLAIN
    over_d = _axis(field_of.of(d), FIELD_CELLS[0], FIELD_SCALES[0])
    first = float(i[0])  # a constant, where the current never varied
    constant = Axis(first, first, np.array([first - 1.0, first + 1.0]), 0, np.ones((1, 1)), (1.0,))
    over_i = _axis(i, FIELD_CELLS[1], FIELD_SCALES[1]) or constant
    add(COENERGY, (over_d, over_i), nominal.force_N * nominal.travel_m, field_of)
    if "hall_V" in channels:
        add(HALL_FIELD, (over_d, over_i), abs(nominal.hall_T_per_A) * nominal.peak_current_A, field_of)
    add("distance_m", (_axis(d, DISTANCE_CELLS, DISTANCE_SCALES),), nominal.travel_m)
    if nominal.peak_current_A > 0.0:
        add("current_A", (_axis(i),), nominal.peak_current_A)
        if {"voltage_V", "voltage_balance_V", "resistance_ohm"} & set(channels):
            add(RESISTANCE, (_axis(np.abs(i)),), nominal.resistance_ohm)
    for name in READINGS:
        if name in channels:
            values = observations.value[observations.of(name)]
            add(name, (_axis(values),), float(np.abs(values).max()))
            if name == "force_N" and {-1.0, 1.0} <= set(table["branch"]):
                add(FORCE_BRANCH, (_axis(values),), float(np.abs(values).max()))
    if FORCE_BALANCE in channels:
        speed = np.abs(table["velocity_m_s"].to_numpy())
        add(BRAKE, (_axis(np.append(speed, 0.0)),), nominal.force_N)
    return result


_PLAIN = DistanceCoordinate(1.0, inverse=False)


def _axis(values: FloatArray, cells: int = CURVE_CELLS, scales: tuple[float, ...] = CURVE_SCALES) -> Axis | None:
    """Over the range of values; None where there is none."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if not high - low > 1e-9 * max(abs(low), abs(high)):
        return None
    knots, expand = bounded_basis(low, high, cells, DEGREE)
    return Axis(low, high, knots, DEGREE, expand, scales)
