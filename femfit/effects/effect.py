"""What an effect is: data and pure functions. It neither ranks nor fits itself.

An effect acts at the stages that it gives a function for, in this order:

=============  =====================================================================================================
``setting``    the bench: recorded distance and current, each by itself -> those that body and winding really have;
               a sensor of the model reads what is recorded
``coenergy``   the magnetics: W' -> W', from which force, flux linkage, back-EMF and Hall field follow together
``energy``     potential energy of a further force on the moving part, which W' is less by
``force``      further force on the moving part, along ``force_N`` (positive towards the electromagnet)
``circuit``    resistance of the winding and voltage that the driver really applies
``mass``       the moving mass
``ends``       the distances of the stops
``hall_point`` the Hall element's delay: distance and current now -> those that its reading belongs to
``memory``     states with their own equation (lag, hysteresis): in plant and filters; on a bench, their value at rest
``impedance``  distance, current and frequency -> what an impedance shows beside W' and the resistance, in ohm
``readings``   the sensors: true channels -> what is recorded
=============  =====================================================================================================
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, SupportsIndex

from femfit.core.graph import Expression
from femfit.core.numerics import BoolArray, FloatArray
from femfit.effects.conditions import Conditions, Nominal, like

Parameters = Mapping[str, Any]

States = Mapping[str, Expression]

CHANNELS = ("force_N", "flux_linkage_Wb", "hall_V", "voltage_V")
"""What a bench reads."""


_UNITS = ("m", "s", "K", "V", "T")


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect: an amplitude of its family, or a nonlinear parameter that only shapes it."""

    name: str  # Ends in its unit, as in the model file; without one it is dimensionless
    bounds: tuple[float, float]  # What physics allows at all: the fit stays within
    plausible: tuple[float, float]  # Outside of it, a fitted value is reported as suspicious
    description: str  # Definition with the sign, as one plain sentence
    # SI unit, or ``readings or s`` of a time that has no clock; as the name says where it is one of :data:`_UNITS`, or
    # so much for each
    unit: str = ""
    # What a value means to an engineer, as a clause with ``{size}`` for the magnitude with its unit, ``{signed}`` for
    # the value, and ``{larger|smaller}`` for words that depend on its sign. Empty where it is not worth saying.
    words: str = ""
    null: float = 0.0  # Where the effect vanishes (amplitudes: 0), or the usual value of a nonlinear parameter
    nonlinear: bool = False  # Whether it shapes what the amplitudes do; it matters only when one of them is not null
    # Quantity of :class:`Nominal` that the value is a part of, its name ending in its unit; empty for one of its own
    scale: str = ""
    # Amplitude that this one goes with: where that one does not count, this one alone would be another effect's
    beside: str = ""

    def __post_init__(self) -> None:
        front, per, each = self.name.rpartition("_per_")
        last = (front if per else self.name).rpartition("_")[2]
        unit = last if last in _UNITS else ""
        object.__setattr__(self, "unit", self.unit or (f"{unit or 1}/{each.replace('2', '^2')}" if per else unit))

    @property
    def lower(self) -> float:
        """Lower bound."""
        return self.bounds[0]

    @property
    def upper(self) -> float:
        """Upper bound."""
        return self.bounds[1]

    @property
    def width(self) -> float:
        """Width of the plausible range, by which fits scale the parameter."""
        return self.plausible[1] - self.plausible[0]


Limits = tuple[float, float, float, float]
"""What physics allows and, between its ends, what is plausible: ascending."""


def parameter_of(
    name: str, limits: Limits, description: str, *, usual: float | None = None, **words: str
) -> EffectParameter:
    """An amplitude, or a nonlinear parameter where it has a usual value."""
    least, low, high, largest = limits
    null, nonlinear = usual or 0.0, usual is not None
    return EffectParameter(name, (least, largest), (low, high), description, null=null, nonlinear=nonlinear, **words)


@dataclass(frozen=True)
class Calibration:
    """A measurement that reads parameters of an effect directly: a reference weight, a shunt, a gauge block."""

    # Parameters of the effect, each with the standard uncertainty that such a measurement usually has, in its unit
    reads: Mapping[str, float]
    cost: float  # In readings of the usual bench sweep: how many could be taken instead
    # What to do, as one plain sentence that holds with and without a magnet in the drawing; the effect's experiment
    # where it is empty
    instruction: str = ""
    # Other effects that show in the same reading: per effect, the change of the first parameter that is read with
    # each of that effect's parameters
    also: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Memory:
    """States that an effect adds to (distance, velocity, current); pure numbers of the order of one, zero at rest.

    Parameters
    ----------
    amplitudes : tuple of str
        Parameters without which, all at null, the states do nothing and are left out.
    spread : float
        Standard deviation of the states where a filter starts.
    steady_state : callable
        (d, i, conditions, p) -> mapping of name to value: where the states stand on a slow bench sweep.
    rate : callable
        (states, i, conditions, p) -> mapping of name to time derivative at the velocity and the current's rate of the
        conditions; linear in that rate for each of its signs.
    response : callable or None
        (s = j w in 1/s, p) -> complex part of the flux linkage that does not follow a small sinusoidal current, the
        body held: what an impedance shows of the states; None where it shows nothing.
    recall : callable or None
        (currents in the order in which they were read, whether a run begins there, nominal) -> mapping of name to
        array, for :attr:`Conditions.recalled`: what ``steady_state`` needs of that order; None where it needs nothing.
    """

    names: tuple[str, ...]
    amplitudes: tuple[str, ...]
    spread: float
    steady_state: Callable[[Expression, Expression, Conditions, Parameters], States]
    rate: Callable[[States, Expression, Conditions, Parameters], States]
    response: Callable[[Any, Parameters], Any] | None = None
    recall: Callable[[FloatArray, BoolArray, Nominal], Mapping[str, FloatArray]] | None = None


def current_lag(
    name: str, amplitude: str, spread: float, lag_time: Callable[[Nominal, Parameters], Expression]
) -> Memory:
    """The current less its mean over a lag's time in s, over the largest: its rate, for what knows no voltage."""

    def rate(states: States, i: Expression, conditions: Conditions, p: Parameters) -> States:
        change = conditions.current_rate_A_s / conditions.nominal.peak_current_A
        return {name: change - states[name] / lag_time(conditions.nominal, p)}

    return Memory((name,), (amplitude,), spread, lambda d, i, conditions, p: {name: 0.0 * i}, rate)


Coenergy = Callable[[Expression, Expression, Expression], Expression]
"""W'(d, i, h) in J, with h a test current in a coil of unit area-turns at the Hall element: dW'/dh is the field."""


@dataclass(frozen=True, eq=False)
class EffectPoint:
    """Where an effect acts, and how much: what every stage is given beside the value that it changes."""

    d: Expression  # Distance in m; 0 in a circuit, which does not know it
    i: Expression  # Current in A, of the effect's circuit
    conditions: Conditions
    p: Parameters
    h: Expression = 0.0  # Test current in A m^2, of a co-energy

    @property
    def nominal(self) -> Nominal:
        """Facts of the base model."""
        return self.conditions.nominal

    @property
    def velocity(self) -> Expression:
        """In m/s, at every point."""
        return like(self.conditions.velocity_m_s, self.d)


Setting = Callable[[EffectPoint], tuple[Expression, Expression]]
CoenergyChange = Callable[[Coenergy, EffectPoint], Expression]
Force = Callable[[EffectPoint], Expression]
CircuitChange = Callable[[Expression, Expression, EffectPoint], tuple[Expression, Expression]]
FurtherImpedance = Callable[[Expression, EffectPoint], Any]
Readings = Callable[[Mapping[str, Expression], EffectPoint], Mapping[str, Expression]]
Words = Callable[[Parameters, Nominal], Sequence[str]]


_ACTS_ON = {
    "setting": "bench",
    "coenergy": "magnetics",
    "energy": "force",
    "force": "force",
    "circuit": "circuit",
    "mass": "motion",
    "ends": "motion",
    "hall_point": "sensor",
    "impedance": "magnetics",
    "eddy": "magnetics",
    "readings": "sensor",
}


@dataclass(frozen=True)
class Effect:
    """A physical effect that a model may lack.

    Parameters
    ----------
    name : str
        As typed by users and written to model files.
    symptom : str
        One plain sentence: what one sees on the bench.
    acts_on : tuple of str
        Where the device or the bench differ; as its stages say where it is not given.
    parameters : tuple of EffectParameter
        Amplitudes of the family's shapes, then shape constants.
    needs : tuple of str
        Columns without which data cannot show it: each entry is a column, or several joined by ``|`` of which one
        is enough. Columns that are constant count as missing where the entry starts with ``~``; ``magnet``, ``iron``,
        ``spring``, ``stop`` and ``voltage driver`` stand for one in the model.
    experiment : str
        The measurement that isolates it, as an instruction.
    words : callable or None
        (p, nominal) -> clauses that say what all parameters together mean, in place of each parameter's own.
    setting, coenergy, energy, force, circuit, impedance, hall_point, readings : callable or None
        The stages where it acts, of an :class:`EffectPoint`; see the module's table. ``coenergy`` depends on distance
        and current, and of the conditions on temperatures and the effect's own states alone. ``circuit`` maps
        (resistance in ohm, voltage in V), and ``impedance`` a frequency in Hz.
    mass : callable or None
        (mass in kg, p) -> mass in kg.
    ends : callable or None
        ((near, far) in m, nominal, p) -> (near, far) in m: where the body is stopped.
    eddy : callable or None
        (factor, p) -> factor of the resistances of the drawing's eddy currents.
    calibrations : tuple of Calibration
        Measurements beside the bench sweep that read parameters directly.
    """

    name: str
    symptom: str
    acts_on: tuple[str, ...] = ()
    parameters: tuple[EffectParameter, ...] = ()
    needs: tuple[str, ...] = ()
    experiment: str = ""
    reference: str = ""
    setting: Setting | None = None
    coenergy: CoenergyChange | None = None
    energy: Force | None = None
    force: Force | None = None
    circuit: CircuitChange | None = None
    mass: Callable[[float, Parameters], float] | None = None
    ends: Callable[[tuple[float, float], Nominal, Parameters], tuple[float, float]] | None = None
    impedance: FurtherImpedance | None = None
    eddy: Callable[[Expression, Parameters], Expression] | None = None
    readings: Readings | None = None
    memory: Memory | None = None
    hall_point: Setting | None = None
    calibrations: tuple[Calibration, ...] = ()
    words: Words | None = None
    # What stands with it in the model file, of an effect that no name finds; see :mod:`femfit.model.carried`
    carried: object | None = None
    of: str = ""  # Which of several circuits it is of; see :mod:`femfit.effects.catalogue`
    title: str = ""  # What texts call it, where its name is a key path
    stands_for: str = ""  # Name of an effect that is no suspect beside this one

    def __post_init__(self) -> None:
        places = dict.fromkeys(place for stage, place in _ACTS_ON.items() if getattr(self, stage) is not None)
        object.__setattr__(self, "acts_on", self.acts_on or tuple(places))
        if (energy := self.energy) is not None:
            object.__setattr__(self, "coenergy", lambda base, point: base(point.d, point.i, point.h) - energy(point))
        read = (c if c.instruction else replace(c, instruction=self.experiment) for c in self.calibrations)
        object.__setattr__(self, "calibrations", tuple(read))

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """The parameters that vanish at their null value."""
        return tuple(p for p in self.parameters if not p.nonlinear)

    @property
    def check(self) -> str:
        """What to do about its cause: the cheapest measurement that reads it directly, or else its experiment."""
        return min(self.calibrations, key=lambda c: c.cost).instruction if self.calibrations else self.experiment

    def null(self) -> dict[str, float]:
        """Parameters at which the effect changes nothing."""
        return {p.name: p.null for p in self.parameters}

    def __reduce_ex__(self, protocol: SupportsIndex) -> str | tuple[Any, ...]:
        """Copy and pickle an effect of the catalogue as its name: functions of its stages may have none.

        One that carries its data is pickled with them.
        """
        from femfit.effects.catalogue import all_effects, effect_by_name  # noqa: PLC0415  it imports this file

        if self.of or all_effects().get(self.name) is self:
            return effect_by_name, (self.name,)
        return super().__reduce_ex__(protocol)


def effect_of(
    *,
    parameter: str,
    limits: Limits,
    description: str,
    words: str | Words = "",
    scale: str = "",
    read: tuple[float, float] | None = None,
    also: Mapping[str, Mapping[str, float]] | None = None,
    **declared: Any,
) -> Effect:
    """An effect of one parameter, declared as an :class:`Effect` and an :class:`EffectParameter` are.

    Parameters
    ----------
    parameter : str
        The parameter's name; its limits, description, words and scale stand beside the effect's own.
    read, also : optional
        Of a :class:`Calibration` that reads the parameter: its standard uncertainty and its cost, and what else shows.
    """
    clause, of_effect = (words, None) if isinstance(words, str) else ("", words)
    amplitude = parameter_of(parameter, limits, description, words=clause, scale=scale)
    calibrations = () if read is None else (Calibration({parameter: read[0]}, read[1], also=also or {}),)
    return Effect(parameters=(amplitude,), words=of_effect, calibrations=calibrations, **declared)


@dataclass(frozen=True)
class AddedEffect:
    """An effect with its parameters, as it stands in a model."""

    data = "name=effect.name", "parameters", "ci95"

    effect: Effect
    parameters: Parameters
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # 95 % intervals, where they were estimated
    runs: tuple[int, int] | None = None  # First and last run of a campaign in which it acts; None for all

    @property
    def memory(self) -> Memory | None:
        """The effect's states, where its parameters need any."""
        memory = self.effect.memory
        null = self.effect.null()
        needed = memory is not None and any(self.parameters[name] != null[name] for name in memory.amplitudes)
        return memory if needed else None


def in_channel(name: str, change: Callable[[Expression, EffectPoint], Expression]) -> Readings:
    """A ``readings`` stage that changes one channel, where it is among the readings."""

    def readings(values: Mapping[str, Expression], point: EffectPoint) -> Mapping[str, Expression]:
        return {**values, name: change(values[name], point)} if name in values else values

    return readings
