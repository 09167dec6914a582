"""Effects that carry their own data: splines in place of a formula, kept with the effect in the model file.

An effect of the catalogue is a formula that its name finds. A carried one is known by what stands with it: a change of
the co-energy W'(d, i) and of the field at the Hall element, from which force, flux linkage, motional constant and
inductance follow together; curves that straighten or bend a sensor; a brake. Each is in proportion to a power of one of
the effect's parameters.

Splines whose outermost cells are constant are constant for ever beyond them (:func:`bounded_basis`): what was learnt
from data then adds no force beyond their distances, nor a flux linkage that grows beyond their currents.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from casadi import SX

from femfit.core.graph import Expression, slope
from femfit.core.numerics import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Coenergy, Effect, EffectParameter, Parameters
from femfit.model.bspline import CellTable, TensorSpline, basis_matrix, cells_of
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.impedance import ImpedanceChange
from femfit.model.magnetics import current_of


@dataclass(frozen=True, eq=False)
class FieldTerm:
    """What one parameter changes of W'(d, i) and of the field at the Hall element."""

    parameter: str
    coordinate: DistanceCoordinate
    coenergy: TensorSpline | None = None  # In (u, i), in J over the parameter's unit
    hall: TensorSpline | None = None  # In (u, i), in T over the parameter's unit
    power: int = 1  # Of the parameter
    # Whether it goes with a / (1 + a) in place of a: with the reciprocal of what a is a share of
    reciprocal: bool = False

    def size(self, p: Parameters) -> Expression:
        """What its splines are multiplied by."""
        value = p[self.parameter]
        return (value / (1.0 + value) if self.reciprocal else value) ** self.power


@dataclass(frozen=True, eq=False)
class FieldChange:
    """The ``coenergy`` stage of a carried effect: W' + sum of a^n S(u(d), i).

    A face at the gap moves as the distance does: where its S is mostly g F, with g the ``gap_m`` by which one unit of
    its parameter a shortens the distance, all orders of W'(d - g a, i) above the first belong to it as well.
    """

    terms: tuple[FieldTerm, ...]
    gap_m: float = 0.0

    def __call__(
        self,
        inner: Coenergy,
        distance: Expression,
        current: Expression,
        hall: Expression,
        conditions: Conditions,  # noqa: ARG002  a stage's signature
        p: Parameters,
    ) -> Expression:
        """The changed co-energy."""
        value = inner(distance, current, hall)
        for term in self.terms:
            for spline, share in ((term.coenergy, 1.0), (term.hall, hall)):
                if spline is not None:
                    at = term.coordinate.of(distance), current_of(SX(current))
                    value += term.size(p) * share * spline.expression(*at)
        if self.gap_m:
            shift = self.gap_m * p[self.terms[0].parameter]

            def still(d: Expression) -> Expression:
                return inner(d, current, 0.0)

            value += still(distance - shift) - still(distance) + shift * slope(still, distance)
        return value


@dataclass(frozen=True, eq=False)
class Curve:
    """A spline of one variable in proportion to a parameter; beyond its knots the values at their ends hold."""

    parameter: str
    knots: FloatArray  # Clamped
    degree: int
    coefficients: FloatArray

    def at(self, x: Expression, p: Parameters) -> Expression:
        """Values at points of any shape, or of an expression."""
        inside = np.clip(x, self.knots[0], self.knots[-1])
        if isinstance(x, SX):
            table = CellTable([cells_of(self.knots, self.degree)], self.coefficients[:, None])
            return p[self.parameter] * table.at(inside)[0]
        values = basis_matrix(np.ravel(inside), self.knots, self.degree) @ self.coefficients
        return np.asarray(p[self.parameter] * values.reshape(np.shape(x)))


@dataclass(frozen=True, eq=False)
class SettingChange:
    """The ``setting`` stage: true minus recorded distance, and current, over what is recorded."""

    distance_m: Curve | None = None
    current_A: Curve | None = None

    def __call__(
        self,
        d: FloatArray,
        i: FloatArray,
        conditions: Conditions,  # noqa: ARG002
        p: Parameters,
    ) -> tuple[FloatArray, FloatArray]:
        """True distances and currents."""
        moved = d if self.distance_m is None else d + self.distance_m.at(d, p)
        return moved, i if self.current_A is None else i + self.current_A.at(i, p)


@dataclass(frozen=True, eq=False)
class ReadingChange:
    """The ``readings`` stage: recorded minus true reading of each channel over the true one.

    On the branch b of the current, 1 where it rises and -1 where it falls, it is c(x) + b h(x).
    """

    channels: Mapping[str, Curve]  # c
    branches: Mapping[str, Curve] = field(default_factory=dict)  # h

    def __call__(
        self,
        values: Mapping[str, FloatArray],
        d: FloatArray,
        i: FloatArray,  # noqa: ARG002
        conditions: Conditions,
        p: Parameters,
    ) -> Mapping[str, FloatArray]:
        """The recorded readings."""
        branch, result = like(conditions.branch, d), dict(values)
        for name, curve in self.channels.items():
            if name in values:
                result[name] = result[name] + curve.at(values[name], p)
        for name, curve in self.branches.items():
            if name in values:
                result[name] = result[name] + branch * curve.at(values[name], p)
        return result


@dataclass(frozen=True, eq=False)
class Brake:
    """The ``force`` stage: a force D(|v|) tanh(|v| / v_0) >= 0 against the velocity."""

    against: Curve  # D over |v|
    rounded_m_s: float  # v_0, so that it goes through zero with the velocity

    def __call__(self, d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:  # noqa: ARG002
        """Towards the electromagnet where the body falls away."""
        v = like(conditions.velocity_m_s, d)
        return np.tanh(v / self.rounded_m_s) * np.maximum(self.against.at(np.abs(v), p), 0.0)


@dataclass(frozen=True, eq=False)
class FurtherResistance:
    """The ``circuit`` stage: resistance of the winding over the magnitude of its current; it never feeds it."""

    over: Curve

    def __call__(
        self,
        resistance: FloatArray,
        voltage: FloatArray,
        current: FloatArray,
        conditions: Conditions,  # noqa: ARG002
        p: Parameters,
    ) -> tuple[FloatArray, FloatArray]:
        """Resistances in ohm, and the voltages as they are."""
        return np.maximum(resistance + self.over.at(np.abs(current), p), 0.0), voltage


@dataclass(frozen=True)
class Conductivity:
    """The ``eddy`` stage: all that conducts does so better by a share, so that eddy currents decay the later."""

    parameter: str

    def __call__(self, p: Parameters) -> float:
        """Factor of the eddy currents' resistances."""
        return 1.0 / (1.0 + p[self.parameter])


@dataclass(frozen=True, eq=False)
class Carried:
    """All that an effect carries; the stages that it has act."""

    magnetics: FieldChange | None = None
    setting: SettingChange | None = None
    readings: ReadingChange | None = None
    brake: Brake | None = None
    resistance: FurtherResistance | None = None
    notes: Mapping[str, str] | None = None  # Texts that go with it, as a law that it follows
    impedance: ImpedanceChange | None = None
    conductivity: Conductivity | None = None


def carried_effect(
    name: str,
    symptom: str,
    parameters: Sequence[EffectParameter],
    carried: Carried,
    *,
    experiment: str = "",
    reference: str = "",
) -> Effect:
    """The effect that acts as its data say."""
    acts = {
        "magnetics": carried.magnetics or carried.impedance or carried.conductivity,
        "bench": carried.setting,
        "sensors": carried.readings,
        "force": carried.brake,
    }
    return Effect(
        name=name,
        symptom=symptom,
        acts_on=tuple(what for what, stage in acts.items() if stage is not None),
        parameters=tuple(parameters),
        needs=(),
        experiment=experiment,
        reference=reference,
        coenergy=carried.magnetics,
        setting=carried.setting,
        readings=carried.readings,
        force=carried.brake,
        circuit=carried.resistance,
        impedance=carried.impedance,
        eddy=carried.conductivity,
        carried=carried,
    )


def bounded_basis(low: float, high: float, cells: int, degree: int) -> tuple[FloatArray, FloatArray]:
    """Knots, and the map E from free coefficients to all, of a spline that is constant outside of its data.

    Over the range there are ``cells`` cells and every spline is possible. Beyond each end ``degree`` further cells lead
    to a constant: in the outermost one the ``degree + 1`` coefficients are equal, and its continuation is that
    constant. By the convex hull of a B-spline its slope stays within the largest slope of its coefficients.

    Returns
    -------
    tuple of (array, array of shape (coefficients, cells + degree))
        Knots, clamped, and E.
    """
    step = (high - low) / cells
    inner = low + step * np.arange(-degree, cells + degree + 1)
    knots = np.concatenate([np.full(degree, inner[0]), inner, np.full(degree, inner[-1])])
    free = cells + degree
    place = np.clip(np.arange(len(knots) - degree - 1) - degree, 0, free - 1)
    return knots, np.asarray(place[:, None] == np.arange(free), dtype=np.float64)
