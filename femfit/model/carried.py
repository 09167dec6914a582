"""Effects that carry their own data: splines in place of a formula, kept with the effect in the model file.

An effect of the catalogue is a formula that its name finds. A carried one is known by what stands with it: a change of
the co-energy W'(d, i) and of the field at the Hall element, from which force, flux linkage, motional constant and
inductance follow together; curves that straighten or bend a sensor; a brake. Each is in proportion to a power of one of
the effect's parameters.

Splines whose outermost cells are constant are constant for ever beyond them (:func:`bounded_basis`): what was learnt
from data then adds no force beyond their distances, nor a flux linkage that grows beyond their currents.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from casadi import SX
from scipy.interpolate import BSpline

from femfit.core.graph import Expression, slope
from femfit.core.numerics import FloatArray
from femfit.effects.conditions import like
from femfit.effects.effect import AddedEffect, Coenergy, Effect, EffectParameter, EffectPoint, Parameters
from femfit.model.bspline import functions, spline_at
from femfit.model.hall import HallSpline
from femfit.model.impedance import ImpedanceChange
from femfit.model.magnetics import CoenergySpline


@dataclass(frozen=True, eq=False)
class FieldTerm:
    """What one parameter changes of W'(d, i) and of the field at the Hall element, over the parameter's unit."""

    parameter: str
    power: int = field(default=1, metadata={"within": (1, 9)})  # Of the parameter
    # Whether it goes with a / (1 + a) in place of a: with the reciprocal of what a is a share of
    reciprocal: bool = field(default=False, metadata={"omit": True})
    coenergy: CoenergySpline | None = field(default=None, metadata={"key": "coenergy_J", "omit": True})
    hall: HallSpline | None = field(default=None, metadata={"key": "hall_T", "omit": True})

    def faults(self) -> Iterator[tuple[str, str]]:
        """No spline at all."""
        if self.coenergy is None and self.hall is None:
            yield "coenergy_J", "a spline, unless there is hall_T"

    def size(self, p: Parameters) -> Expression:
        """What its splines are multiplied by."""
        value = p[self.parameter]
        return (value / (1.0 + value) if self.reciprocal else value) ** self.power


@dataclass(frozen=True, eq=False)
class Curve:
    """A spline of one variable in proportion to a parameter; beyond its knots the values at their ends hold."""

    parameter: str
    knots: FloatArray = field(metadata={"degree": "degree"})  # Clamped
    degree: int = field(metadata={"within": (1, 9)})
    coefficients: FloatArray = field(metadata={"shape": lambda c: (functions(c.knots, c.degree),)})

    def at(self, x: Expression, p: Parameters) -> Expression:
        """Values at points of any shape, or of an expression."""
        inside = np.clip(x, self.knots[0], self.knots[-1])
        if isinstance(x, SX):
            axes = [(self.knots, self.degree)]
            return p[self.parameter] * spline_at(self, axes, self.coefficients[:, None], inside)[0]
        return np.asarray(p[self.parameter] * BSpline(self.knots, self.coefficients, self.degree)(inside))


@dataclass(frozen=True, eq=False)
class Brake:
    """The ``force`` stage of a force D(|v|) tanh(|v| / v_0) >= 0 against the velocity."""

    rounded_m_s: float = field(metadata={"positive": True})  # v_0, so that it goes through zero with the velocity
    against: Curve  # D over |v|

    def __call__(self, point: EffectPoint) -> Expression:
        """The force: towards the electromagnet where the body falls away."""
        size = np.maximum(self.against.at(np.abs(point.velocity), point.p), 0.0)
        return np.tanh(point.velocity / self.rounded_m_s) * size


@dataclass(frozen=True)
class Conductivity:
    """The ``eddy`` stage where all that conducts does so better by a share: eddy currents decay the later."""

    parameter: str

    def __call__(self, factor: Expression, p: Parameters) -> Expression:
        """Factor of the eddy currents' resistances."""
        return factor / (1.0 + p[self.parameter])


@dataclass(frozen=True, eq=False)
class Carried:
    """All that an effect carries; what is there acts.

    A face at the gap moves as the distance does: where its S is mostly g F, with g the ``gap_m`` by which one unit of
    its parameter a shortens the distance, all orders of W'(d - g a, i) above the first belong to it as well.
    """

    # W' + sum of a^n S(u(d), i); without terms that of a field which changes though it is not known how
    magnetics: tuple[FieldTerm, ...] | None = field(default=None, metadata={"omit": True})
    # True minus recorded distance, and current, over what is recorded
    setting: Mapping[str, Curve] = field(default_factory=dict, metadata={"omit": True})
    # Recorded minus true reading of each channel over the true one: on the branch b of the current, 1 where it rises
    # and -1 where it falls, c(x) + b h(x)
    readings: Mapping[str, Curve] = field(default_factory=dict, metadata={"omit": True})  # c
    branches: Mapping[str, Curve] = field(default_factory=dict, metadata={"omit": True})  # h
    brake: Brake | None = field(default=None, metadata={"omit": True})
    # Resistance of the winding over the magnitude of its current; it never feeds it
    resistance: Curve | None = field(default=None, metadata={"omit": True})
    impedance: ImpedanceChange | None = field(default=None, metadata={"omit": True})
    conductivity: Conductivity | None = field(default=None, metadata={"omit": True})
    # Texts that go with it, as a law that it follows
    notes: Mapping[str, str] = field(default_factory=dict, metadata={"omit": True})
    gap_m: float = field(default=0.0, metadata={"key": None})

    def unknown(self, parameters: Sequence[str]) -> Iterator[tuple[str, str]]:
        """Faults of a file: parameters that an effect of these does not have."""
        groups = {name: getattr(self, name) for name in ("setting", "readings", "branches")}
        holders: dict[str, Any] = {f"magnetics[{k}]": term for k, term in enumerate(self.magnetics or ())}
        holders |= {f"{group}.{name}": curve for group, curves in groups.items() for name, curve in curves.items()}
        holders |= {name: getattr(self, name) for name in ("resistance", "impedance", "conductivity")}
        holders["brake.against"] = self.brake and self.brake.against
        for path, holder in holders.items():
            if holder is not None and holder.parameter not in parameters:
                yield f"{path}.parameter", f"one of the effect's ({', '.join(sorted(parameters))})"

    def coenergy_stage(self, inner: Coenergy, point: EffectPoint) -> Expression:
        """The changed co-energy."""
        value = inner(point.d, point.i, point.h)
        for term in self.magnetics or ():
            for spline, share in ((term.coenergy, 1.0), (term.hall, point.h)):
                if spline is not None:
                    value += term.size(point.p) * share * spline.expression(point.d, SX(point.i))
        if self.gap_m and self.magnetics:
            shift = self.gap_m * point.p[self.magnetics[0].parameter]

            def still(d: Expression) -> Expression:
                return inner(d, point.i, 0.0)

            value += still(point.d - shift) - still(point.d) + shift * slope(still, point.d)
        return value

    def setting_stage(self, point: EffectPoint) -> tuple[Expression, Expression]:
        """True distance and current."""
        d, i = (
            x + self.setting[name].at(x, point.p) if name in self.setting else x
            for name, x in (("distance_m", point.d), ("current_A", point.i))
        )
        return d, i

    def readings_stage(self, values: Mapping[str, Expression], point: EffectPoint) -> Mapping[str, Expression]:
        """The recorded readings."""
        result = dict(values)
        for curves, side in ((self.readings, 1.0), (self.branches, like(point.conditions.branch, point.d))):
            for name, curve in curves.items():
                if name in values:
                    result[name] = result[name] + side * curve.at(values[name], point.p)
        return result

    def circuit_stage(
        self, resistance: Expression, voltage: Expression, point: EffectPoint
    ) -> tuple[Expression, Expression]:
        """Resistance in ohm, and the voltage as it is."""
        change = 0.0 if self.resistance is None else self.resistance.at(np.abs(point.i), point.p)
        return np.maximum(resistance + change, 0.0), voltage

    def effect(self, name: str, symptom: str, parameters: Sequence[EffectParameter], **facts: Any) -> Effect:
        """The effect that acts as these data say, with further facts of it."""
        return Effect(
            name=name,
            symptom=symptom,
            parameters=tuple(parameters),
            coenergy=self.coenergy_stage if self.magnetics is not None else None,
            setting=self.setting_stage if self.setting else None,
            readings=self.readings_stage if self.readings or self.branches else None,
            force=self.brake,
            circuit=self.circuit_stage if self.resistance else None,
            impedance=self.impedance,
            eddy=self.conductivity,
            carried=self,
            **facts,
        )


@dataclass(frozen=True, eq=False)
class FiledCarried:
    """An effect that carries its data, in a model file."""

    symptom: str
    experiment: str
    reference: str
    parameters: tuple[EffectParameter, ...]
    carried: Carried = field(metadata={"flat": True})

    def faults(self) -> Iterator[tuple[str, str]]:
        """Parameters that the effect does not have."""
        return self.carried.unknown([p.name for p in self.parameters])

    def effect(self, name: str) -> Effect:
        """The effect itself."""
        texts = {key: value for key, value in vars(self).items() if key != "carried"}
        return self.carried.effect(name, **texts)


@dataclass(frozen=True, eq=False)
class FiledEffect:
    """An added effect in a model file: by the name of one of the catalogue or the drawing, or with what it carries."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)  # Others change nothing
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    carried: FiledCarried | None = field(default=None, metadata={"omit": True})

    @classmethod
    def of(cls, added: AddedEffect) -> "FiledEffect":
        """An effect as the file has it."""
        effect, carried = added.effect, None
        if isinstance(effect.carried, Carried):
            carried = FiledCarried(**{f.name: getattr(effect, f.name) for f in fields(FiledCarried)})
        return cls(effect.name, added.parameters, added.ci95, carried)


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
