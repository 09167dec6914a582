"""The actuator model: the one object that simulator, filters, comparison and every export read."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as limited
from functools import cached_property
from typing import Any, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike

from femfit.core.errors import DomainError, MissingPartError
from femfit.core.numerics import ABSOLUTE_ZERO_C, ComplexArray, FloatArray
from femfit.core.results import Plotted, Words
from femfit.core.sweep_columns import circuit_currents
from femfit.device.electrics import Circuit
from femfit.device.mechanics import Mechanics
from femfit.effects.conditions import NO_MAGNET, REFERENCE_TEMPERATURE_C, Conditions
from femfit.effects.effect import AddedEffect, Memory
from femfit.model.carried import FiledEffect
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.eddy_currents import EddyCurrents, EddyMagnetics
from femfit.model.equations import Equations
from femfit.model.hall import HallSensor, OtherSensor
from femfit.model.magnetics import CoenergySpline, LawMagnetics, Magnetics, Windings
from femfit.model.readings import impedances_at
from femfit.model.sample_step import SampleStep
from femfit.model.several_magnetics import FORMULA, NETWORK, CoenergyMatrix, CoenergyTensor, NetworkMagnetics
from femfit.model.validity import ActuatorKind, Misfit, ProcessNoise, ValidityBox
from femfit.model.with_effects import with_parts

Part = TypeVar("Part")
Values = TypeVar("Values", FloatArray, ComplexArray)

STRONGER = 1.05
"""Chosen: ratio of forces from which the other sign of currents is preferred; fits of steel make signs differ less."""


@dataclass(frozen=True, eq=False, repr=False)
class ActuatorModel(Plotted):
    """An actuator as the estimator and the simulator need it.

    Parameters
    ----------
    magnetics : Magnetics
        Co-energy spline or force law.
    circuits : tuple of Circuit
        Windings and what feeds them, in the order of their currents; none for a pair of magnets, and where the sweep's
        source did not give them. With n of several, currents have the shape (..., n).
    motion, sensor : optional
        Mechanics, Hall element; absent where the sweep's source did not give them.
    sample_time_s : float
        Period of the controller and filter; a millisecond where neither a drawing nor the device says otherwise.
    reference_distances_m : tuple of float
        Steps of the closed-loop reference; empty: derived from the model.
    covariance : array or None
        Of the law's coefficients, in their order.
    effects : tuple of AddedEffect
        Added after comparison with measurements, in the order of adding.
    base : ActuatorModel or None
        The model without its effects: magnetics, circuits, motion and sensor above are this one's, as the effects
        change them. None where there are no effects.
    conditions : Conditions or None
        Under which plant and filters have the effects act; None where there are none.
    coil_temperature_C, magnet_temperature_C : float
        At which plant and filters run; matters only to effects that know temperatures.
    kind : ActuatorKind or None
        What the drawing is made of; None where the model was fitted to a table without a drawing.
    other_sensors : tuple
        All sensors but the Hall element; :func:`femfit.model.sensors.predict_sensor` says what they read.
    process_noise : ProcessNoise or None
        Found from a record; a filter derives it from the model's misfit where None.
    drawn : tuple of DrawnEffect
        Numbers of the drawing with what each of them changes; none where the sweep has no signatures.
    eddy : EddyCurrents or None
        Eddy currents as windings that are short-circuited; None where the drawing has no conducting parts.
        :meth:`force` and what stands beside it are those without them.

    Examples
    --------
    >>> import femfit as ff
    >>> model = ff.read_model("model.json")
    >>> print(f"{model.force(0.022, 0.5):.4f} N, {model.inductance(0.022, 0.5):.4f} H")
    0.0567 N, 0.0162 H
    >>> model.force(0.1, 0.5)
    Traceback (most recent call last):
    ...
    femfit.core.errors.DomainError: ...
    """

    name: str
    magnetics: Magnetics = limited(
        metadata={"kinds": (CoenergySpline, CoenergyMatrix, CoenergyTensor, NetworkMagnetics, LawMagnetics)}
    )
    validity: ValidityBox
    circuits: tuple[Circuit, ...] = ()
    motion: Mechanics | None = None
    sensor: HallSensor | None = None
    misfit: Misfit | None = None
    sample_time_s: float = limited(default=1e-3, metadata={"required": True, "positive": True})
    reference_distances_m: tuple[float, ...] = ()
    covariance: FloatArray | None = limited(default=None, metadata={"dimensions": (2,)})
    effects: tuple[AddedEffect, ...] = limited(default=(), metadata={"form": FiledEffect})
    base: "ActuatorModel | None" = limited(default=None, metadata={"key": None})
    conditions: Conditions | None = limited(default=None, metadata={"key": None})
    coil_temperature_C: float = limited(default=REFERENCE_TEMPERATURE_C, metadata={"lower": ABSOLUTE_ZERO_C})
    magnet_temperature_C: float = limited(default=REFERENCE_TEMPERATURE_C, metadata={"lower": ABSOLUTE_ZERO_C})
    kind: ActuatorKind | None = None
    # What files did not have before there were any is left out where there are none
    other_sensors: tuple[OtherSensor, ...] = limited(
        default=(), metadata={"omit": True, "kinds": get_args(OtherSensor)}
    )
    process_noise: ProcessNoise | None = limited(default=None, metadata={"omit": True})
    drawn: tuple[DrawnEffect, ...] = limited(default=(), metadata={"omit": True})
    eddy: EddyCurrents | None = limited(default=None, metadata={"omit": True})
    provenance: Mapping[str, Any] = limited(default_factory=dict, metadata={"required": True})

    def __post_init__(self) -> None:
        conditions = self.conditions
        if conditions is None:
            return
        now, before = ((of.coil_temperature_C, of.magnet_temperature_C) for of in (self, conditions))
        if not np.array_equal(now, before, equal_nan=True):
            anew = with_parts(self)  # effects make something else of it
            ohms = zip(self.circuits, anew.resistances_ohm.tolist(), strict=True)
            sensor = self.sensor and replace(self.sensor, field=anew.require_sensor().field)
            changed: dict[str, Any] = {"magnetics": anew.magnetics, "conditions": anew.conditions, "sensor": sensor}
            changed["circuits"] = tuple(replace(circuit, resistance_ohm=ohm) for circuit, ohm in ohms)
            for name, section in changed.items():
                object.__setattr__(self, name, section)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Parts of a file that do not go together."""
        names, circuits = [sensor.name for sensor in self.other_sensors], self.circuit_names
        for k, name in enumerate(names):
            if names.count(name) > 1 or name == "hall":
                yield f"other_sensors[{k}].name", "a name of its own, and not hall"
        if self.motion is not None and not self.motion.ends[0] < self.motion.ends[1]:
            yield "motion.far_stop", "at a larger distance than near_stop"
        if self.eddy is not None and circuits and self.eddy.circuits != circuits:
            yield "eddy.circuits", f"those of the model ({', '.join(circuits)}), in their order"

    def __str__(self) -> str:
        return sentence("model", "model", self)

    def force(self, distance: ArrayLike, current: ArrayLike, *, extrapolate: bool = False) -> FloatArray:
        """Magnetic force on the moving part in N, positive towards smaller distance.

        Parameters
        ----------
        distance, current : array_like
            In m and A; they broadcast. With n circuits currents have the shape (..., n), in the order of
            :attr:`circuits`.
        extrapolate : bool
            Whether points outside of the validity domain are evaluated all the same.

        Raises
        ------
        DomainError
            If a point lies outside of the validity domain and ``extrapolate`` is false.
        ValueError
            If the shapes do not broadcast.
        """
        return self._squeezed(self.magnetics.force(*self._points(distance, current, extrapolate)))

    def flux_linkage(self, distance: ArrayLike, current: ArrayLike, *, extrapolate: bool = False) -> FloatArray:
        """Flux linkage of the winding in Wb, (..., n) of several; arguments and errors as of :meth:`force`."""
        return self._squeezed(self.magnetics.flux_linkage(*self._points(distance, current, extrapolate)), 1)

    def inductance(self, distance: ArrayLike, current: ArrayLike, *, extrapolate: bool = False) -> FloatArray:
        """Inductance d(flux linkage)/di in H, (..., n, n) of several; arguments and errors as of :meth:`force`."""
        return self._squeezed(self.magnetics.inductance(*self._points(distance, current, extrapolate)), 2)

    def impedance(
        self, distance: ArrayLike, current: ArrayLike, frequency: ArrayLike, *, extrapolate: bool = False
    ) -> ComplexArray:
        """Impedance of the circuit in ohm for a small current about a bias, (..., n, n) of several.

        Z = R + j 2 pi f (L + L_s) with the winding's resistance and what is in series with it, less what eddy currents
        take off; of a model with the effect ``eddy_current_lag`` a part of L lags.

        Parameters
        ----------
        distance, current : array_like
            As of :meth:`force`; the current is the bias.
        frequency : array_like
            In Hz; it broadcasts with the others.

        Raises
        ------
        MissingPartError
            If the model has no circuit.
        DomainError
            As of :meth:`force`, and for frequencies below zero.

        Examples
        --------
        >>> import femfit as ff
        >>> model = ff.read_model("model.json")
        >>> z = model.impedance(0.022, 0.5, 100.0)
        >>> print(f"{z.real:.2f} ohm, {z.imag / (2 * 3.14159 * 100.0):.4f} H")
        """
        if not self.require_circuits():
            self.require_circuit()
        d, i = self._points(distance, current, extrapolate)
        f = np.asarray(frequency, dtype=np.float64)
        if not (np.isfinite(f) & (f >= 0.0)).all():
            raise DomainError("Frequencies must be numbers >= 0, in Hz. Leave out what is no frequency.")
        return self._squeezed(impedances_at(self, d, i, f), 2)

    def _squeezed(self, values: Values, axes: int = 0) -> Values:
        """Without the axes of circuits where there are not several: a number for two numbers."""
        several = len(self.validity.current_limits_A) > 1
        return values[()] if several else values.sum(axis=tuple(range(-axes, 0)))  # of one entry, or of none

    def _points(self, distance: ArrayLike, current: ArrayLike, extrapolate: bool) -> tuple[FloatArray, FloatArray]:
        """Distances (...) and currents (..., n) from what a caller gives, in the domain unless it says otherwise."""
        d, currents = np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
        i = self.validity.with_axis(currents)
        np.broadcast_shapes(d.shape, i.shape[:-1])
        if not extrapolate:
            self.validity.require(d, i)
            if not i.shape[-1] and np.any(currents != 0.0):
                raise DomainError(
                    f"The current must be 0 A, for model {self.name!r} has no winding; instead received "
                    f"{currents.ravel()[np.flatnonzero(currents)[0]]:g} A."
                )
        return d, i

    @property
    def without_effects(self) -> "ActuatorModel":
        """The model as fitted, before effects were added; itself where there are none."""
        return self.base or self

    @cached_property
    def without_eddies(self) -> "ActuatorModel":
        """The model of a device whose parts conduct nothing; itself where it has no eddy currents."""
        if self.eddy is None:
            return self
        return replace(self, eddy=None, base=self.base and self.base.without_eddies)

    @cached_property
    def equations(self) -> Equations:
        """The equations of its motion."""
        return Equations(self)

    @cached_property
    def diodes(self) -> list[tuple[int, float]]:
        """Circuits that a freewheel diode feeds, and its drop in V."""
        drives = [(k, circuit.drive) for k, circuit in enumerate(self.circuits) if circuit.drive.kind == "voltage"]
        return [(k, drive.diode_V) for k, drive in drives if drive.diode_V is not None]

    @cached_property
    def sample_step(self) -> SampleStep:
        """The steps that filters take of them."""
        return SampleStep(self)

    @property
    def has_magnet(self) -> bool:
        """Whether the drawing has a magnet; without a drawing, whether force or flux remain without current.

        Less than a thousandth of the largest force and flux linkage, or than the model misses its table by, counts as
        the fit's own error. False where :attr:`magnet_known` is false.
        """
        if self.kind is not None:
            return self.kind.has_magnet
        return self.magnet_known and self.without_effects.share_without_current() >= NO_MAGNET

    @property
    def has_winding(self) -> bool:
        """Whether a current flows anywhere; none does in a pair of magnets."""
        box = self.validity
        return bool(self.circuits) or bool(box.current_limits_A.any())

    @property
    def magnet_known(self) -> bool:
        """Whether a drawing, or a validity domain with a current of zero, can tell if there is a magnet."""
        domain = self.validity
        return self.kind is not None or all(low <= 0.0 <= high for low, high in domain.current_limits_A)

    def share_without_current(self) -> float:
        """Larger of force and flux linkage without current, each over its largest in the validity domain.

        Zero for one that is smaller than the model's largest misfit; of the flux linkage three times its rms stands for
        that.
        """
        domain, misfit = self.validity, self.misfit
        still = np.linspace(domain.distance_min_m, domain.distance_max_m, 15)
        no_current = np.zeros((15, len(domain.current_limits_A)))
        idle = self.magnetics.force(still, no_current), self.magnetics.flux_linkage(still, no_current)
        errors = (misfit.force_max_N, 3.0 * (misfit.flux_linkage_rms_Wb or 0.0)) if misfit is not None else (0.0, 0.0)
        remaining = [float(np.abs(values).max(initial=0.0)) for values in idle]
        return max((r / most for r, most, e in zip(remaining, self.peaks, errors, strict=True) if r > e), default=0.0)

    @cached_property
    def peaks(self) -> tuple[float, float]:
        """Largest force in N and flux linkage in Wb over the validity domain."""
        x = self.validity.grid(15, 15, several=5)
        force, flux = (np.abs(of(*x)).max(initial=0.0) for of in (self.magnetics.force, self.magnetics.flux_linkage))
        return float(force), float(flux)

    @cached_property
    def weakest_current_A(self) -> float:  # noqa: N802  the unit
        """Current of the validity domain that attracts least, by the force's mean over the distances.

        Zero for steel alone, which a current of either sign attracts; the lowest current where a magnet gives the force
        its sign.
        """
        domain, ends = self.validity, (self.validity.current_min_A, self.validity.current_max_A)
        currents = np.unique(np.append(np.linspace(*ends, 41), np.clip(0.0, *ends)))
        d, i = np.meshgrid(np.linspace(domain.distance_min_m, domain.distance_max_m, 41), currents)
        return float(currents[np.argmin(self.magnetics.force(d, i[..., None]).mean(axis=1))])

    def attracting_range(self, low: float, high: float) -> tuple[float, float]:
        """The part of a range of currents in A over which the force grows with the current, or with its magnitude.

        Where either sign attracts, it is the positive one, unless the other attracts more by :data:`STRONGER`.
        """
        weakest = self.weakest_current_A
        if not low < weakest < high:
            return low, high
        below, above = (self.magnetics.force(self.validity.grid(41, 1)[0], np.array([i])).mean() for i in (low, high))
        return (low, weakest) if below > STRONGER * above else (weakest, high)

    @property
    def eddy_names(self) -> tuple[str, ...]:
        """States of the eddy currents, after those of the circuits."""
        return tuple(f"{name}_A" for name in self.eddy.names) if self.eddy is not None else ()

    @cached_property
    def memory_names(self) -> tuple[str, ...]:
        """States that effects add to (distance, velocity, currents, eddy currents)."""
        return tuple(name for memory in self.memories for name in memory.names)

    @property
    def effects_drive(self) -> bool:
        """Whether the equations of motion and current differ from those of the model's W', R and m."""
        return bool(self.memories) or any(added.effect.force or added.effect.circuit for added in self.effects)

    @property
    def memories(self) -> tuple[Memory, ...]:
        """Those of effects whose parameters need states, which follow a winding's current."""
        return tuple(added.memory for added in self.effects if added.memory is not None and self.circuits)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states of :mod:`femfit.model.dynamics`, with units."""
        currents = circuit_currents(self.circuit_names)
        return ("distance_m", "velocity_m_s", *currents, *self.eddy_names, *self.memory_names)

    @cached_property
    def order(self) -> int:
        """Number of these states."""
        return 2 + self.windings.count + len(self.memory_names)

    @cached_property
    def windings(self) -> Windings:
        """Circuits and eddy currents together, as the equations of motion have them."""
        magnetics, patterns = self.magnetics, np.zeros(0)
        if self.eddy is not None:
            magnetics, patterns = EddyMagnetics(magnetics, self.eddy), self.eddy.resistances_ohm
        series = np.diag(np.append(np.diag(self.series_inductances_H), 0.0 * patterns))
        return Windings(magnetics, np.append(self.resistances_ohm, patterns), series)

    @property
    def travel_m(self) -> tuple[float, float]:
        """Shortest and longest distance that the body can have: the validity domain between its stops, in m."""
        low, high = self.validity.distance_min_m, self.validity.distance_max_m
        near, far = (low, high) if self.motion is None else self.motion.ends
        return max(low, near), min(high, far)

    @property
    def circuit(self) -> Circuit | None:
        """The only circuit; None where there is none, or more than one."""
        return self.circuits[0] if len(self.circuits) == 1 else None

    @property
    def circuit_names(self) -> tuple[str, ...]:
        """Names of the circuits, in their order."""
        return tuple(circuit.name for circuit in self.circuits)

    @property
    def current_names(self) -> tuple[str, ...]:
        """Names of the currents that the co-energy depends on: of the circuits, also where these are not known."""
        count = len(self.validity.current_limits_A)
        return self.circuit_names or tuple(getattr(self.without_effects.magnetics, "names", ("coil",) * count))

    @cached_property
    def resistances_ohm(self) -> FloatArray:
        """Resistance of each circuit, shape (n,)."""
        return np.array([circuit.resistance_ohm for circuit in self.circuits])

    @cached_property
    def series_inductances_H(self) -> FloatArray:  # noqa: N802  the unit
        """What is in series with the coils outside of the field, on the diagonal of a matrix of shape (n, n)."""
        return np.diag(np.array([circuit.inductance_H for circuit in self.circuits]))

    def currents_of(self, state: FloatArray) -> FloatArray:
        """The circuits' currents (..., n) of states of shape (..., order)."""
        return state[..., 2 : 2 + len(self.circuits)]

    def require_circuits(self) -> tuple[Circuit, ...]:
        """All circuits, which only a device without a winding may lack; else :class:`MissingPartError`."""
        box = self.validity
        winding = self.kind.coil if self.kind is not None else box.current_max_A > box.current_min_A
        return self._required(self.circuits or None, *_CIRCUIT) if winding else self.circuits

    def require_circuit(self) -> Circuit:
        """The only circuit, or :class:`MissingPartError` with the remedy."""
        if len(self.circuits) > 1:
            raise MissingPartError(
                f"Model {self.name!r} must have one circuit for this; it has {len(self.circuits)}: "
                f"{', '.join(circuit.name for circuit in self.circuits)}. Take a drawing with one circuit, for example "
                "both coils in series."
            )
        if not self.has_winding:
            raise MissingPartError(f"Model {self.name!r} must have a circuit for this; its drawing has no coil.")
        return self._required(self.circuit, *_CIRCUIT)

    def require_motion(self) -> Mechanics:
        """The motion, or :class:`MissingPartError` with the remedy."""
        return self._required(self.motion, "motion (moving mass)", "[moving] mass_g")

    def require_sensor(self) -> HallSensor:
        """The sensor, or :class:`MissingPartError` with the remedy."""
        return self._required(self.sensor, "sensor that tells the distance", "[sensors.NAME] of kind hall or position")

    def require_dynamics(self) -> None:
        """Refuse a model whose motion and current cannot be integrated.

        Raises
        ------
        MissingPartError
            If circuit or motion is absent, or the inductance is not positive everywhere in the validity domain, as in a
            law fitted to forces alone.
        """
        self.require_motion()
        if self.require_circuits() and not self.smallest_inductance_H > 0.0:
            raise MissingPartError(
                f"Model {self.name!r} must have an inductance > 0 for its current to be computed; it goes down to "
                f"{self.smallest_inductance_H:g} H. Fit a table with flux linkage, or give femfit fit --inductance-H."
            )

    @property
    def smallest_inductance_H(self) -> float:  # noqa: N802  the unit
        """Least eigenvalue of the inductances over the validity domain; infinite without a winding."""
        inductance = self.magnetics.inductance(*self.validity.grid(9, 9, several=3))
        return float(np.linalg.eigvalsh(inductance).min(initial=np.inf))

    def _required(self, section: Part | None, name: str, keys: str) -> Part:
        if section is None:
            raise MissingPartError(
                f"Model {self.name!r} must have a {name} for this; it has none. Fit it again with an actuator file "
                f"that gives {keys} (for an imported table: femfit fit TABLE --actuator ACTUATOR.toml)."
            )
        return section


_CIRCUIT = "circuit (winding resistance and supply)", "[coils.NAME] and [supply]"


def eddy_times(model: "ActuatorModel") -> FloatArray:
    """Time constants in s of the eddy currents' states over the distances, while nothing changes the circuits'."""
    windings, n = model.windings, len(model.circuits)
    d = np.linspace(model.validity.distance_min_m, model.validity.distance_max_m, 9)
    self_inductance = windings.magnetics.inductance(d, np.zeros((9, windings.count)))[:, n:, n:]
    root = np.sqrt(windings.resistances_ohm[n:])
    return np.asarray(np.linalg.eigvalsh(self_inductance / (root[:, None] * root)))


sentence = Words("femfit.model", names={"NETWORK": NETWORK, "FORMULA": FORMULA, "eddy_times": eddy_times}).sentence
