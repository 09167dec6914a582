"""The equations of a model in motion as one expression, from which steps, slopes and readings are derived.

State (d, v, w, z): w are all windings' currents, the circuits' and after them the eddy patterns', which are windings
that are short-circuited; z are the states of effects. With W'(d, w, z),

    F = -dW'/dd,  L w' + (d^2 W'/dw dz) z' = U - R w + k_m v,  k_m = -d^2 W'/dw dd,

and z' grows linearly with the rate u' of the current that a core sees, for each of its signs: u = i, and beside eddy
currents u = i + C e, so that u' = G w' + C' e v. The bracket L + (dl/dz) (dz'/du') keeps the sign of the right side.

A step of the filters takes forces and inductances where the body is half-way, and is exact for currents that decay or
grow at any stiffness: what a current does to its own rate is R + dL/dt, with the dL/dt of iron that saturates and of a
body that moves, and what a body induces grows with its speed (:mod:`femfit.model.decay`). The force follows the
currents' mean over the step, and their mean square. The step is of second order; :mod:`femfit.model.sample_step` makes
samples of it.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), sections 3.1 and 5.1.
M. Hochbruck and A. Ostermann, Acta Numerica 19 (2010) 209, section 2.4: exponential Rosenbrock methods.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression, GraphFunction, building, of_variable, once, slope
from femfit.core.numerics import FloatArray
from femfit.device.mechanics import Mechanics
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.stages import circuit_of, with_further_force
from femfit.model.decay import ResponseTable, decayed, eliminated, shares
from femfit.model.drive import LEAST_SPEED_M_S, between, endless, met_stops

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel

_LEAKAGE = 0.05
"""Least part of the inductance that a changing state leaves: leakage flux passes air, whatever the core does."""


@dataclass(frozen=True, eq=False)
class Driver:
    """What ends a winding's current at a value with the step, as far as its voltages allow: a diode or an amplifier."""

    circuit: int
    current: SX  # In A, at the end of the step
    voltages: tuple[Any, Any]  # Least and largest beside the voltage that the step is given, in V

    def beside(self, volts: SX) -> "Driver":
        """The same driver where the step is given this voltage more."""
        low, high = (end if endless(end) else end - volts for end in self.voltages)
        return replace(self, voltages=(low, high))


@dataclass(frozen=True, eq=False)
class _Moment:
    """A state, and what of W' and of the forces moves it; the states of effects are those of the first circuit's core.

    Attributes
    ----------
    turns, drift : SX
        G, and u' at held currents.
    along : SX
        By which the circuit's flux linkage grows with the states; as G's first entry is 1.
    """

    distance: SX
    velocity: SX
    currents: SX
    linkage: SX
    inductance: SX  # With what is in series
    motional_constant: SX
    force: SX  # All but the weight and what the mechanics add
    pull: SX  # By which it grows with the currents
    acceleration: SX
    conditions: Conditions  # With the states of effects
    core_current: SX  # u
    turns: SX
    drift: SX
    along: SX

    def driving(self, circuits: tuple[SX, SX, SX], speed: SX) -> SX:
        """Voltages that change the currents of a body with a speed."""
        resistances, volts, _ = circuits
        return volts - resistances * self.currents + self.motional_constant * speed

    def core_rate(self, rate: SX) -> SX:
        """The rate u' where all windings' currents have these."""
        return ca.dot(self.turns, rate) + self.drift


@dataclass(frozen=True, eq=False)
class _Step:
    """A step of the filters, from what moves the body where it is half-way."""

    moment: _Moment
    length: SX
    mobility: SX  # Acceleration for each newton, nought of a body that goes on at its speed
    speed: SX  # Along which the body induces a voltage
    gain: SX  # That speed's growth
    linear: bool  # Whether inductances depend on the distance alone
    table: ResponseTable | None  # Of what the step makes of the currents
    drivers: Sequence[Driver]

    def means(self, resistances: SX, inductance: SX, driving: SX) -> tuple[SX, SX, SX]:
        """Means of velocity, acceleration and the currents' rates, with these circuits at first."""
        moment, h, w, drivers = self.moment, self.length, self.moment.currents, self.drivers
        slope_by_currents = ca.jacobian(moment.motional_constant, w)
        units = SX.eye(w.numel())[:, [driver.circuit for driver in drivers]]
        if drivers:  # by Euler's implicit step, so that what follows has little to add
            rates = eliminated(inductance + h * ca.diag(resistances), ca.horzcat(driving, units))
            more = driver_voltages(drivers, w + h * rates[:, 0], h * rates[:, 1:])
            driving, drivers = driving + units @ more, [of.beside(more[k]) for k, of in enumerate(drivers)]
        both, against = ca.horzcat(driving, moment.motional_constant * self.gain, units), ca.diag(resistances)

        def responses(volts: SX) -> Sequence[SX]:
            if self.table is None:
                return decayed(inductance, against, volts, h)
            return [response @ volts for response in self.table.at(moment.distance)]

        if self.linear:  # dL/dt of the way, by the currents' mean rates
            both[:, 1] += self.speed * slope_by_currents @ responses(driving)[0]
        else:
            direction = SX.sym("r", w.numel())  # dL/dt of currents with these rates, (m, m)
            change = ca.jacobian(ca.jtimes(moment.linkage, w, direction), w)
            change = ca.substitute(change, direction, eliminated(inductance, driving)) - self.speed * slope_by_currents
            against += _slowed(change, ca.diag(inductance) / h + resistances)
        ends, means, ways = responses(both)
        if drivers:
            more = driver_voltages(drivers, w + h * (ends[:, 0] + h * means[:, 1]), h * ends[:, 2:])
            for parts in (ends, means, ways):
                parts[:, 0] += parts[:, 2:] @ more
        changed = h * (means[:, 0] + h * ways[:, 1])
        curved = ca.dot(changed, slope_by_currents @ changed)  # the mean square of even growth is 4/3 of this
        late = moment.acceleration / 2.0 - self.mobility * (h * ca.dot(moment.pull, ways[:, 0]) + curved / 6.0)
        acceleration = moment.acceleration - self.mobility * (ca.dot(moment.pull, changed) + 2.0 / 3.0 * curved)
        return moment.velocity + h * late, acceleration, ends[:, 0] + h * means[:, 1]


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of a model; functions of (state, voltage of each circuit, (step, time, free)).

    A body that is not free goes on at its speed.
    """

    model: "ActuatorModel"

    @property
    def rates(self) -> GraphFunction:
        """Time derivative of the state."""
        return self.function("rates", lambda x, u, _h, _t, free: self.rates_at(x, u, free))

    def flow(self, driven: tuple[int, ...] = (), *, slope: bool = False) -> GraphFunction:
        """Time derivative of the state without dry friction, and after it the voltages that the circuits' drivers give.

        Parameters
        ----------
        driven : tuple of int
            The circuits whose currents have the rates in A/s that stand in the place of their voltages.
        slope : bool
            Whether the Jacobian by the state and these inputs is asked for instead, column after column.
        """

        def made(x: SX, u: SX, *_: SX) -> SX:
            flow = ca.vertcat(*self.flow_at(x, u, driven))
            return ca.vec(ca.jacobian(flow, ca.vertcat(x, u))) if slope else flow

        return self.function(("flow", driven, slope), made)

    def step(self, length: float | None) -> GraphFunction:
        """The state one step later; of one length in s, or of any that is given with each state where None."""
        length = None if self._losses is None else length
        key = "step", length
        return self.function(key, lambda x, u, h, _, free: self.step_at(x, u, h if length is None else length, free))

    def function(self, key: Hashable, make: Callable[..., SX]) -> GraphFunction:
        """A function of the equations, made once of the expressions (state, voltage, step, time, free)."""

        def made() -> GraphFunction:
            x, u, inputs = SX.sym("x", self.model.order), SX.sym("u", len(self.model.circuits)), SX.sym("inputs", 3)
            return GraphFunction([x, u, inputs], make(x, u, *ca.vertsplit(inputs)))

        return once(self, key, made)

    @cached_property
    def _losses(self) -> FloatArray | None:
        """What currents take from their own windings in ohm, (m,), beside eddy currents, where all is linear.

        The inductances of all windings then depend on the distance alone, and what currents take on nothing.
        """
        if self.model.eddy is None or self.model.memories:
            return None
        with building():
            d, v, w = SX.sym("d"), SX.sym("v"), SX.sym("w", self.model.windings.count)
            moment = self._moment(ca.vertcat(d, v, w))
            of_distance = GraphFunction([d, w], ca.vec(moment.inductance)).leaves_out(w)
            taken = self._circuits(SX.sym("u", len(self.model.circuits)), w, moment.conditions)[2]
            return np.array(ca.DM(taken)).ravel() if of_distance and taken.is_constant() else None

    def _responses(self, length: float) -> ResponseTable:
        box, windings, losses = self.model.validity, self.model.windings, cast("FloatArray", self._losses)

        def inductance(distance: FloatArray) -> FloatArray:
            still = np.zeros((len(distance), windings.count))
            return windings.magnetics.inductance(distance, still) + windings.series_H

        ends = box.distance_min_m, box.distance_max_m
        return once(self, ("responses", length), lambda: ResponseTable(inductance, losses, length, ends))

    def parts(self, state: SX) -> tuple[SX, SX, SX, dict[str, SX]]:
        """Distance, velocity, currents of all windings, and states of effects by name."""
        end, names = self.model.windings.end, self.model.memory_names
        return state[0], state[1], state[2:end], dict(zip(names, ca.vertsplit(state[end:]), strict=True))

    def _within(self, function: Callable[[SX], SX], distance: SX, state: SX) -> SX:
        """A function of the state at a distance: of a body that its stops let no further, though it may be beyond."""
        ends = self.model.require_motion().ends
        return of_variable(function, ca.vertcat(between(distance, ends), state[1:]))

    def rates_at(self, state: SX, voltage: SX, free: SX | float = 1.0) -> SX:
        """Time derivative of an expression's state."""
        return self._within(lambda x: self._flow(self._moment(x), voltage, free, ())[0], state[0], state)

    def flow_at(self, state: SX, values: SX, driven: tuple[int, ...]) -> tuple[SX, SX]:
        """Time derivative of an expression's state without dry friction, and the voltages that the drivers give.

        Parameters
        ----------
        values : SX
            Voltages of the circuits.
        driven : tuple of int
            The circuits whose currents have the rates in A/s that stand in the place of their voltages.
        """
        smooth = replace(self.model.require_motion(), coulomb_N=0.0)
        return self._flow(self._moment(state, smooth), values, 1.0, driven)

    def _flow(self, moment: _Moment, values: SX, free: SX | float, driven: tuple[int, ...]) -> tuple[SX, SX]:
        acceleration, places = free * moment.acceleration, list(driven)
        if not moment.currents.numel():  # no current that a state of an effect could follow
            return ca.vertcat(moment.velocity, acceleration), values
        commanded, imposed = SX(values), values[places]
        commanded[places] = 0.0
        circuits = self._circuits(commanded, moment.currents, moment.conditions)
        inductance, driving = self._beside(moment, moment.driving(circuits, moment.velocity), (places, imposed))
        rate, more = _imposed(inductance, driving, places, imposed)
        if driven:
            commanded[places] = self._commanded(circuits[1][places] + more, moment)
        return ca.vertcat(moment.velocity, acceleration, rate, self._followed(moment, rate)), commanded

    def step_at(
        self,
        state: SX,
        voltage: SX,
        length: SX | float,
        free: SX | float = 1.0,
        stops: Mechanics | None = None,
        drivers: Sequence[Driver] = (),
    ) -> SX:
        """An expression's state a step in s later.

        Parameters
        ----------
        stops : Mechanics or None
            Between whose ends the body's way lies along which it induces a voltage.
        drivers : sequence of Driver
            That end currents at values of their own.
        """
        h, table = SX(length), None
        if self._losses is not None and not isinstance(length, SX):
            table = self._responses(length)

        def way(v: SX, acceleration: SX) -> tuple[SX, SX]:
            if stops is None:
                return v, acceleration
            end = state[0] + h * (v + 0.5 * h * acceleration)
            reached = met_stops(stops, (state[0], v), (end, v + h * acceleration), h)[0]
            met = ca.fabs(reached - end) > 0.0
            return ca.if_else(met, (reached - state[0]) / h, v), ca.if_else(met, 0.0, acceleration)

        def means(x: SX) -> SX:
            moment = self._moment(x)
            freedom = free * shares(-h * _braking(moment.acceleration, moment.velocity, h))[0]
            moment = replace(moment, acceleration=freedom * moment.acceleration)
            if not moment.currents.numel():
                return ca.vertcat(moment.velocity + 0.5 * h * moment.acceleration, moment.acceleration)
            along = way(moment.velocity, moment.acceleration)
            mobility = freedom / self.model.require_motion().mass_kg
            step = _Step(moment, h, mobility, *along, self._losses is not None, table, drivers)
            return self._means(step, voltage)

        return state + h * self._within(means, state[0] + 0.5 * h * state[1], state)

    def _means(self, step: _Step, voltage: SX) -> SX:
        """Means of the state's rates over a step."""
        moment, half, memory = step.moment, 0.5 * step.length, step.moment.conditions.memory
        conditions = self.conditions(moment.velocity, memory, moment.motional_constant * step.speed)
        then = replace(moment, conditions=conditions)
        circuits = self._circuits(voltage, moment.currents, then.conditions)
        driving = moment.driving(circuits, step.speed)
        v, acceleration, rate = step.means(circuits[2], *self._beside(then, driving))
        if memory:  # the same beside the states and the current half-way
            z = ca.vertcat(*memory.values())
            change = half * self._followed(then, rate, half)
            stronger = step.mobility * (ca.jacobian(moment.force, z) @ change)
            later, speed = dict(zip(memory, ca.vertsplit(z + change), strict=True)), step.speed + half * step.gain
            conditions = self.conditions(speed, later, moment.motional_constant * speed)
            current = moment.core_current + half * moment.core_rate(rate)
            then = replace(moment, conditions=conditions, currents=moment.currents + half * rate, core_current=current)
            v, acceleration, rate = step.means(circuits[2], *self._beside(then, driving))
            v, acceleration = v - step.length / 3.0 * stronger, acceleration - stronger
            then = replace(then, conditions=replace(conditions, memory=memory))  # from the states at first
        return ca.vertcat(v, acceleration, rate, self._followed(then, rate, step.length))

    def _moment(self, state: SX, mechanics: Mechanics | None = None) -> _Moment:
        """What moves a state, with other mechanics on demand."""
        model, windings = self.model, self.model.windings
        mechanics = mechanics or model.require_motion()
        d, v, w, memory = self.parts(state)
        value = windings.magnetics.with_memory(memory)(d, w)
        linkage = ca.gradient(value, w)
        motional_constant = -ca.jacobian(linkage, d)
        conditions = self.conditions(v, memory, motional_constant * v)
        first = w[0] if w.numel() else SX(0.0)
        effects_force = SX(with_further_force(model.effects, 0.0, d, first, conditions))
        force, current, along = effects_force - ca.gradient(value, d), SX(0.0), SX.zeros(len(memory))
        if model.circuits:
            current = first if model.eddy is None else model.eddy.acting(d, w)[0][0]
            along = ca.jacobian(linkage[0], ca.vertcat(SX(0, 1), *memory.values())).T
        return _Moment(
            distance=d,
            velocity=v,
            currents=w,
            linkage=linkage,
            inductance=ca.jacobian(linkage, w) + windings.series_H,
            motional_constant=motional_constant,
            force=force,
            pull=motional_constant + ca.gradient(effects_force, w),
            acceleration=mechanics.acceleration(d, v, force, model.sample_time_s),
            conditions=conditions,
            core_current=current,
            turns=ca.densify(ca.gradient(current, w)),
            drift=ca.gradient(current, d) * v,
            along=along,
        )

    def _beside(self, moment: _Moment, driving: SX, imposed: tuple[list[int], SX] = ([], SX(0, 1))) -> tuple[SX, SX]:
        """Inductance and driving voltages beside what states of effects do."""
        if not moment.conditions.memory:
            return moment.inductance, driving
        still = self._memory_rates(moment, SX(0.0))
        driving = driving - moment.turns * ca.dot(moment.along, still)
        share = ca.dot(moment.turns, eliminated(moment.inductance, moment.turns))
        rate, _ = _imposed(moment.inductance, driving, *imposed)
        sign = ca.if_else(moment.core_rate(rate) < 0.0, -1.0, 1.0)
        change = sign * (self._memory_rates(moment, sign) - still)
        taken = ca.fmax(ca.dot(moment.along, change), (_LEAKAGE - 1.0) / share)
        driving = driving - moment.turns * (taken * moment.drift)
        return moment.inductance + taken * moment.turns @ moment.turns.T, driving

    def _followed(self, moment: _Moment, rate: SX, step: SX | None = None) -> SX:
        """Rates z' where all windings' currents have these; over a step in s their means.

        A state with z' = a - b z moves by (a - b z) (1 - exp(-b h)) / b, however fast it decays.
        """
        memory = moment.conditions.memory
        if not memory:
            return SX(0, 1)

        def followed(z: SX) -> SX:
            states = dict(zip(memory, ca.vertsplit(z), strict=True))
            there = replace(moment, conditions=replace(moment.conditions, memory=states))
            rates = self._memory_rates(there, moment.core_rate(rate), rate[0])
            if step is None:
                return rates
            decays = ca.vertsplit(ca.diag(ca.jacobian(rates, z)))
            return rates * ca.vertcat(*(shares(-step * decay)[0] for decay in decays))

        return of_variable(followed, ca.vertcat(*memory.values()))

    def _circuits(self, voltage: SX, w: SX, conditions: Conditions) -> tuple[SX, SX, SX]:
        """Resistances of all windings, the voltages at them, and what each current takes from its own in ohm."""
        model, windings = self.model, self.model.windings
        resistances = SX(windings.resistances_ohm)
        volts = ca.vertcat(voltage, SX.zeros(windings.count - voltage.numel()))
        if len(model.circuits) == 1:
            base = model.without_effects.circuits[0]
            resistances[0], volts[0] = circuit_of(model.effects, base.resistance_ohm, voltage[0], w[0], conditions)
        return resistances, volts, -ca.diag(ca.jacobian(volts - resistances * w, w))  # a supply that sags takes, too

    def _commanded(self, applied: SX, moment: _Moment) -> SX:
        """The voltages to command so that these are applied, from beyond a driver's dead zone on."""
        model = self.model
        if len(model.circuits) > 1 or not any(added.effect.circuit for added in model.effects):
            return applied
        far = applied + ca.if_else(applied < 0.0, -1.0, 1.0) * moment.conditions.nominal.voltage_V

        def driver(voltage: SX) -> SX:
            return SX(circuit_of(model.effects, SX(0.0), voltage, moment.currents[0], moment.conditions)[1])

        return far + (applied - driver(far)) / slope(driver, far)

    def conditions(self, v: SX, memory: Mapping[str, SX], motional: SX | None = None) -> Conditions:
        """What effects are told of an expression's velocity, states and motional voltages."""
        conditions = self.model.conditions
        if conditions is None:
            return Conditions(cast("Nominal", None))  # no effect asks for its facts
        volts = motional[0] if motional is not None and motional.numel() else SX(0.0)
        return replace(conditions, velocity_m_s=v, memory=memory, motional_V=volts)

    def _memory_rates(self, moment: _Moment, rate: SX, of_circuit: SX | None = None) -> SX:
        """Rates z' at a rate of the core's current; a sensor's states follow the circuit's own, where that is given."""
        rates: dict[str, Expression] = {}
        for added in self.model.effects:
            if added.memory is None:
                continue
            with_core = of_circuit is None or added.effect.coenergy is not None
            current, its_rate = (moment.core_current, rate) if with_core else (moment.currents[0], of_circuit)
            conditions = replace(moment.conditions, current_rate_A_s=its_rate)
            rates |= added.memory.rate(conditions.memory, current, conditions, added.parameters)
        return ca.vertcat(SX(0, 1), *(rates[name] for name in moment.conditions.memory))


def driver_voltages(drivers: Sequence[Driver], reached: SX, response: SX) -> SX:
    """Voltages of drivers beside those given, that end their currents as these have them, or are at their limits.

    Whoever is beyond a limit is held there, and the others are found again, as often as there are drivers: that is
    exact for two, and for more unless windings are nearly one.

    Parameters
    ----------
    reached : SX
        All windings' currents after the step, in A.
    response : SX
        What a volt at each driver's winding adds to it.

    References
    ----------
    M. Hintermueller, K. Ito and K. Kunisch, SIAM J. Optimization 13 (2003) 865: primal-dual active sets.
    """
    places = [driver.circuit for driver in drivers]
    gain = response[places, :]
    missing = ca.vertcat(*(driver.current for driver in drivers)) - reached[places]

    def limited(volts: SX) -> SX:
        return ca.vertcat(*(between(volts[k], driver.voltages) for k, driver in enumerate(drivers)))

    more = SX.zeros(len(drivers))
    for _ in drivers:
        wanted = more + (missing - gain @ more) / ca.diag(gain)
        held = limited(wanted)
        free = wanted == held
        among = ca.diag(1.0 - free) + free @ free.T * gain
        more = free * eliminated(among, free * (missing - gain @ ((1.0 - free) * held))) + (1.0 - free) * held
    return limited(more)


def _braking(acceleration: SX, velocity: SX, step: SX) -> SX:
    """Slope of an acceleration by the velocity in 1/s, over a step in s: of the chord to the velocity after it.

    Of the chord to rest where dry friction, which stops the body within the step, would throw it back.
    """
    slope = ca.jacobian(acceleration, velocity)
    if not ca.depends_on(slope, velocity):
        return slope
    gain = step * acceleration
    after = ca.substitute(acceleration, velocity, velocity + gain)
    stops = (ca.fabs(velocity) > LEAST_SPEED_M_S) * (velocity * (velocity + gain) < 0.0) * (after * acceleration < 0.0)
    ahead = ca.if_else(stops, ca.substitute(acceleration, velocity, 0.0), after)
    way = ca.if_else(stops, -velocity, gain)
    moves = ca.fabs(way) > LEAST_SPEED_M_S
    return ca.if_else(moves, (ahead - acceleration) / ca.if_else(moves, way, 1.0), slope)


def _slowed(change: SX, room: SX) -> SX:
    """dL/dt, made less where a current would grow more than e-fold within a step: of a negative inductance beyond."""
    return change / ca.fmax(1.0, ca.mmax(-ca.diag(change) / room))


def _imposed(inductance: SX, driving: SX, places: list[int], rates: SX) -> tuple[SX, SX]:
    """Currents' rates L^-1 b where those at some places are given, and the voltages that these need beside b."""
    if not places:
        return eliminated(inductance, driving), SX(0, 1)
    both = eliminated(inductance, ca.horzcat(driving, SX.eye(driving.numel())[:, places]))
    rate, by_volt = both[:, 0], both[:, 1:]
    more = eliminated(by_volt[places, :], rates - rate[places])
    return rate + by_volt @ more, more
