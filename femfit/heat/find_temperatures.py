"""Where a drawing's temperatures settle, and what winding and magnet are then."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from femfit.core.errors import DomainError, MissingPartError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.results import listing
from femfit.core.text import amount, amount_range
from femfit.device.load import read_actuator
from femfit.device.parts import REFERENCE_TEMPERATURE, Actuator, LinearMaterial
from femfit.device.thermal import Surroundings
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.heat.balance import Feed, feed_of, hottest, largest_loads, time_until
from femfit.heat.network import HeatNetwork, heat_network
from femfit.heat.result import MagnetWarmth, Temperatures
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.with_effects import with_effects
from femfit.tables.eddy_table import EddyTable, read_eddy

SPREAD = 1.5
"""Assumed: factor either way within which the heat that a free face gives off is known."""

SETTLED = 1.0 - np.exp(-1.0)
"""Of the rise, after one time constant."""


def find_temperatures(
    actuator: Actuator | str | Path,
    *,
    current_A: float | Sequence[float] | None = None,
    voltage_V: float | Sequence[float] | None = None,
    distance_m: float | None = None,
    alternating_A: float | Sequence[float] = 0.0,
    frequency_Hz: float | None = None,
    sweep: str | Path | None = None,
    model: ActuatorModel | str | Path | None = None,
) -> Temperatures:
    """Find the temperatures at which a drawing's parts settle, by a network of its parts.

    Parameters
    ----------
    actuator : Actuator or path
        With ``[thermal]`` where its surroundings are not the usual ones.
    current_A, voltage_V : float or sequence of float
        What is held, of each circuit; without either, the most that the supply gives.
    distance_m : float
        At which the moving part is held; by default the first reference distance, or the shortest that it can have.
    alternating_A : float or sequence of float
        Rms value of a sinusoidal current beside it.
    frequency_Hz, sweep : float and path
        Of that current, and a sweep with ``frequency_Hz``, for the heat of its eddy currents.
    model : ActuatorModel or path
        Of the drawing, for what the force loses.

    Raises
    ------
    MissingPartError
        If there is no coil, or the sweep has no eddy currents.
    UsageError
        If what is given does not fit together.

    Examples
    --------
    >>> import femfit as ff
    >>> warm = ff.find_temperatures("rig.toml", current_A=0.8)
    >>> print(f"{warm.windings_C[0]:.0f} degC, {warm.resistances_ohm[0]:.2f} ohm")
    61 degC, 3.12 ohm
    """
    actuator = actuator if isinstance(actuator, Actuator) else read_actuator(actuator)
    distance = _held_distance(actuator) if distance_m is None else distance_m
    network = heat_network(actuator, distance)
    if (sweep is None) != (frequency_Hz is None):
        raise UsageError("Eddy currents need both a frequency and a sweep. Give both or none.")
    if voltage_V is None and current_A is None and np.any(alternating_A):
        current_A = 0.0
    feed = feed_of(actuator, network, voltage_V, current_A, alternating_A)
    if sweep is not None and frequency_Hz is not None:
        if not np.any(feed.alternating_A):
            raise UsageError("A frequency must stand beside an alternating current; there is none. Give alternating_A.")
        table = _eddy_table(sweep, actuator, distance, frequency_Hz)
        feed = replace(feed, eddy_W=_eddy_heat(network, table, distance, frequency_Hz, feed.alternating_A))
    around = actuator.thermal
    bounds = [
        heat_network(
            replace(actuator, thermal=replace(around, film_W_per_m2_K=factor * around.film_W_per_m2_K)), distance
        )
        for factor in (SPREAD, 1.0 / SPREAD)
    ]
    find = partial(_found, around, network, bounds, distance)
    result = find(feed)
    if model is not None and result.settles:
        result = replace(result, force=_forces(model, feed, result))
    if 0.0 < result.allowed_factor < np.inf:
        limit = feed.held(result.allowed_factor, result.currents_A)
        at_limit = find(limit)
        force = None if model is None else _forces(model, limit, at_limit)
        result = replace(result, at_limit=replace(at_limit, force=force, limit_s=None))  # which it only approaches
    return result


def temperatures_at_supply(actuator: Actuator, model: ActuatorModel) -> Temperatures | None:
    """Temperatures at the most that a drawing's supply gives; None where it has no coil or no limits."""
    try:
        return find_temperatures(actuator, model=model)
    except (MissingPartError, UsageError):
        return None


def _found(
    around: Surroundings, network: HeatNetwork, bounds: list[HeatNetwork], distance: float, feed: Feed
) -> Temperatures:
    ambient = around.ambient_C
    start, count = np.full(len(network.names), ambient), len(network.windings)
    warm, *spread = (feed.settled(way_out, ambient) for way_out in (network, *bounds))
    currents = feed.currents(start if np.isnan(warm).any() else warm)
    factor, limiting = largest_loads(network, around, feed.loads(currents))
    rise = warm[0] - ambient
    until = partial(time_until, network, ambient, feed.powers)
    return Temperatures(
        names=network.names,
        count=count,
        distance_m=distance,
        surroundings=around,
        temperatures_C=warm,
        hottest_C=hottest(network, ambient, warm),
        spread_C=np.array([settled[:count].max() for settled in spread]),
        volts=feed.volts,
        cold_currents_A=feed.currents(start),
        currents_A=currents,
        alternating_A=feed.alternating_A,
        cold_resistances_ohm=feed.resistances(start),
        resistances_ohm=feed.resistances(warm),
        heat_W=feed.powers(warm),
        eddy_W=feed.eddy_W,
        settling_s=until(lambda now: float(now[0] - ambient - SETTLED * rise)) if rise > 0.0 else None,
        limit_s=until(lambda now: float(hottest(network, ambient, now).max() - around.winding_limit_C)),
        allowed_factor=float(np.sqrt(factor)),
        limiting=limiting,
        magnets=_magnets(network, warm),
        force=None,
        network=network,
    )


def _eddy_table(sweep: str | Path, actuator: Actuator, distance: float, frequency: float) -> EddyTable:
    table = read_eddy(Path(sweep))
    if table is None:
        raise MissingPartError(f"{sweep} must hold eddy currents; sweep the drawing with [solver] frequency_Hz.")
    low, high = table.distances_m[[0, -1]]
    if not low <= distance <= high:
        raise UsageError(f"The distance must lie within that sweep, {amount_range(low, high, 'm', 3)}.")
    highest = float(table.checked_Hz[-1])
    if not 0.0 < frequency <= highest:
        raise UsageError(
            f"The frequency must be above 0 and within that sweep, up to {amount(highest, 'Hz', 3)}; it is "
            f"{amount(frequency, 'Hz', 3)}. Give another one, or sweep with higher ones in [solver] frequency_Hz."
        )
    drawn = {region.material.name for region in actuator.regions}
    circuits = tuple(circuit.name for circuit in actuator.circuits)
    if circuits != table.circuits or not drawn.issuperset(table.materials):
        raise UsageError(
            f"The sweep must be of this drawing; {sweep} has circuits {listing(table.circuits)} and conducting "
            f"materials {listing(table.materials)}. Sweep the drawing anew."
        )
    return table


def _held_distance(actuator: Actuator) -> float:
    """Distance in m at which the moving part is held if nothing else is said."""
    if actuator.reference_distances_m:
        return actuator.reference_distances_m[0]
    return max(min(actuator.sweep.distances_m), actuator.mechanics.ends[0])


def _eddy_heat(
    network: HeatNetwork, table: EddyTable, distance: float, frequency: float, currents: FloatArray
) -> FloatArray:
    """Heat of each part in W: a material's loss, by the volumes of its parts."""
    place = int(np.argmin(np.abs(table.distances_m - distance)))
    losses = table.losses(place, np.array([frequency]), currents)[0]
    volumes = network.volumes_m3[len(network.windings) :]
    members = np.array([[region.material.name == name for region in network.regions] for name in table.materials])
    return np.concatenate([np.zeros(len(network.windings)), losses / (members @ volumes) @ members * volumes])


def _magnets(network: HeatNetwork, temperatures: FloatArray) -> tuple[MagnetWarmth, ...]:
    magnets = []
    for region, celsius in zip(network.regions, temperatures[len(network.windings) :], strict=True):
        material = region.material
        if isinstance(material, LinearMaterial) and material.remanence_T:
            change = material.remanence_coefficient_per_K * (celsius - REFERENCE_TEMPERATURE)
            drawn = material.remanence_coefficient_per_K * (material.temperature_C - REFERENCE_TEMPERATURE)
            working_C = material.thermal.working_temperature_C
            magnets.append(MagnetWarmth(region.name, float(celsius), float(change), float(drawn), working_C))
    return tuple(magnets)


def _forces(model: ActuatorModel | str | Path, feed: Feed, result: Temperatures) -> tuple[float, float] | None:
    """Force in N as it is switched on and once it is warm; None where the model ends below."""
    model, forces = model_of(model), []
    for temperatures in (np.full(len(result.names), result.surroundings.ambient_C), result.temperatures_C):
        changes = [
            (1.0 + magnet.change) / (1.0 + magnet.drawn) - 1.0 for magnet in _magnets(result.network, temperatures)
        ]
        warm = model
        if any(changes):  # of several magnets the mean
            effect = AddedEffect(effect_by_name("remanence"), {"remanence_error": float(np.mean(changes))})
            warm = with_effects(model, [*model.effects, effect])
        currents = feed.currents(temperatures)
        try:
            forces.append(float(warm.force(result.distance_m, currents if len(currents) > 1 else currents[0])))
        except DomainError:
            return None
    return forces[0], forces[1]
