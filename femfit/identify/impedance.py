"""Impedances of a bench table: how they are weighed, and what they may be off by away from the eddy currents' bias.

An instrument's errors of resistance and reactance go with the magnitude |Z|. Readings, predictions and slopes are
multiplied by a magnitude that is usual over |Z| of each reading, so that a channel has one noise: by the winding's
resistance, and for an inductance by its own over |Z| / w.

Eddy currents beside iron that saturates were solved about a bias. Away from it the iron has another permeability, by a
factor that the model does not know. Skin layers go with the product of permeability and conductivity, so that the
impedance is off as if the iron conducted otherwise. With

    x = |lambda(d, i) - lambda(d, b(d))| / lambda_s,

lambda_s a flux linkage that begins to saturate the iron, x is the standard deviation of the logarithm of that
conductivity: a permeability that goes with a power of the flux of the order of one gives so much. A solid lifting
magnet of 1010 that was solved about 2.5 and 3.0 A is off at 1.3 and 1.6 A by 0.44 and 0.46, where x is 0.47. What that
leaves of its error is up to 0.8 % of |Z|. Of any form may be the second order of it, and what the circuits' inductances
differ, |L(d, i) - L(d, b)| / L, of the induced voltage.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from femfit.core.numerics import BIAS_SHARE, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.sweep_columns import resistance_column
from femfit.core.text import amount_range
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.identify.constants import FREQUENCY_SLACK, LEAST_LINKED, OF_THREE
from femfit.identify.observations import Observations
from femfit.identify.words import finding
from femfit.model.actuator_model import ActuatorModel
from femfit.model.eddy_currents import EddyBias
from femfit.model.impedance import SHORTED
from femfit.model.readings import predict_readings
from femfit.tables.circuit_columns import parts_of
from femfit.tables.impedance import SERIES
from femfit.tables.measurement import IMPEDANCE_SHARE


@dataclass(frozen=True, eq=False)
class AwayFromBias:
    """How far each row of a table is from the bias; zeros where the patterns hold for all currents."""

    flux: FloatArray  # x, below the bias' flux with a minus, shape (N,)
    inductance: FloatArray  # Difference of the circuits' inductances over the larger ones, shape (N,)
    of_circuits: FloatArray = field(default_factory=lambda: np.zeros(1))  # Largest entry of L in H, shape (N,)


def away_from_bias(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> AwayFromBias:
    """How far rows at distances (N,) and currents (N,) or (N, n) are from the model's bias."""
    base = model.without_effects
    bias, still = base.eddy.bias if base.eddy else None, np.zeros(len(distance))
    if bias is None:
        return AwayFromBias(still, still)
    here, there = current.reshape(len(distance), -1), bias.at(distance)

    def linked_by(currents: FloatArray) -> FloatArray:
        """Flux linkages of currents (N, n), shape (N, n)."""
        return base.magnetics.flux_linkage(distance, currents)

    read, solved = linked_by(here), linked_by(there)
    apart = np.minimum(*(np.linalg.norm(read - sign * solved, axis=1) for sign in (1.0, -1.0)))  # all turned is alike
    apart *= np.where(np.linalg.norm(read, axis=1) < np.linalg.norm(solved, axis=1), -1.0, 1.0)
    ends = np.array(np.meshgrid(*base.validity.current_limits_A)).reshape(here.shape[1], -1).T
    linked = [linked_by(np.tile(end, (len(distance), 1))) for end in ends]
    largest = np.linalg.norm(linked, axis=-1).max()
    sizes = [base.magnetics.inductance(distance, currents) for currents in (here, there)]
    changed, *norms = (np.linalg.norm(matrix, axis=(1, 2)) for matrix in (sizes[0] - sizes[1], *sizes))
    return AwayFromBias(apart / (BIAS_SHARE * largest), changed / np.maximum(*norms), np.abs(sizes[0]).max(axis=(1, 2)))


def with_bias(observations: Observations, model: ActuatorModel, away: FloatArray) -> Observations:
    """Impedances with what their distance from the bias may make of each, as columns of one standard deviation.

    Parameters
    ----------
    away : array, shape (N,)
        x of every row, as of :class:`AwayFromBias`.
    """
    eddy = model.without_effects.eddy
    bias = eddy.bias if eddy else None
    if bias is None or not observations.of_impedances or not away.any():
        return observations
    keys = [f"materials.{name}.conductivity_MS_per_m" for name in bias.materials]
    conduct = [drawn for drawn in model.without_effects.drawn if drawn.key in keys]
    as_drawn = [AddedEffect(drawn.effect, {drawn.parameter: 0.0}) for drawn in conduct]
    slopes = observations.slopes(as_drawn, [(k, drawn.parameter) for k, drawn in enumerate(conduct)])
    off = away[observations.row, None]
    sides = [side for side in (np.maximum(off, 0.0), np.maximum(-off, 0.0)) if side.any()]  # each has its own factor
    tolerance = np.hypot(observations.tolerance, np.linalg.norm(0.5 * off**2 * slopes, axis=1))
    observations = replace(observations, bias_columns=np.hstack([side * slopes for side in sides]), tolerance=tolerance)
    size = np.array([observations.magnitude.get(name, np.inf) for name in observations.channels])[observations.channel]
    share = (eddy.error.impedance or 0.0) if eddy and eddy.error else 0.0
    beyond = np.unique(observations.row[observations.own_misfit > share * size])
    if not len(beyond):
        return observations
    return replace(observations, findings=(*observations.findings, _finding(observations, bias, beyond)))


def _finding(observations: Observations, bias: EddyBias, rows: IntArray) -> Finding:
    held, names = bias.at(observations.covariates["distance_m"].to_numpy()), observations.currents
    currents = observations.covariates[list(names)].to_numpy()

    def said(of: FloatArray) -> str:
        each = [amount_range(float(values.min()), float(values.max()), "A") for values in of[rows].T]
        of_circuits = [f" in {circuit}" if circuit else "" for _, circuit in map(parts_of, names)]
        return " and ".join(a + b for a, b in zip(each, of_circuits, strict=True))

    least = [float(f"{median:.3g}") for median in np.median(currents[rows], axis=0)]
    facts: dict[str, Any] = {"asked": least[0] if len(least) == 1 else least, "materials": bias.materials}
    facts |= {"read": said(currents), "held": said(held), "rows": len(rows)}
    return finding("eddy-bias", "current_A", float(len(rows)), **facts)


@dataclass(frozen=True, eq=False)
class Weighing:
    """How readings of each channel are weighed; empty where they are no impedances."""

    weight: Mapping[str, FloatArray] = field(default_factory=dict)  # Of every row, shape (N,), by channel
    magnitude: Mapping[str, float] = field(default_factory=dict)  # At which a channel's readings are given, in its unit
    noise: Mapping[str, float] = field(default_factory=dict)  # Declared as a share of |Z|
    tolerance: Mapping[str, FloatArray] = field(default_factory=dict)  # Of the model's eddy currents, of every row
    findings: tuple[Finding, ...] = ()


def weighed_by_magnitude(
    model: ActuatorModel,
    distance: FloatArray,
    current: FloatArray,
    conditions: Conditions,
    channels: Collection[str],
    declared: Mapping[str, float],
    away: AwayFromBias,
) -> Weighing:
    """The weights of impedances, by the model's own magnitude; of a channel with a noise in its unit they are 1."""
    names = [name for name in channels if parts_of(name)[0] in SERIES and name not in declared]
    nominal, w = conditions.nominal, 2.0 * np.pi * np.asarray(conditions.frequency_Hz)
    if not names or not np.isfinite(w).all():
        return Weighing()
    read = predict_readings(model, distance, current, conditions, channels=SERIES)
    magnitude = {
        name: np.hypot(read.get(resistance_column(name), 0.0), w * values)
        for name, values in read.items()
        if parts_of(name)[0] == "inductance_H"
    }
    largest = np.max(list(magnitude.values()), axis=0)
    size, most, turned = {}, {}, {}
    induced = np.minimum(largest, w * away.of_circuits)  # eddy currents make it no larger
    for name, z in magnitude.items():
        off = largest * (OF_THREE if name.endswith(SHORTED) else 1.0)
        for channel, scale in ((resistance_column(name), 1.0), (name, w)):
            size[channel], most[channel] = np.maximum(z, LEAST_LINKED * largest) / scale, off / scale
            turned[channel] = away.inductance * induced / scale
    usual = {name: float(getattr(nominal, parts_of(name)[0])) for name in names}
    share, error = declared.get(IMPEDANCE_SHARE), model.eddy.error if model.eddy is not None else None
    eddy_misfit = (
        (error.impedance or 0.0) / np.sqrt(3.0) if error is not None else 0.0
    )  # of errors that are evenly spread
    quantities = dict.fromkeys(parts_of(name)[0] for name in names)
    usual_sizes = [(of, float(getattr(nominal, of))) for of in quantities]
    findings, frequency = [finding("weighed", usual=usual_sizes)], np.asarray(conditions.frequency_Hz)
    beyond = 0 if error is None else int((frequency > (1.0 + FREQUENCY_SLACK) * error.frequency_max_Hz).sum())
    if error is not None and beyond:  # there the model's eddy currents were not held against the field
        facts: dict[str, Any] = {"beyond": beyond, "held": error.frequency_max_Hz, "highest": float(frequency.max())}
        findings.append(finding("frequency-range", "frequency_Hz", float(beyond), **facts))
    return Weighing(
        {name: usual[name] / size[name] for name in names},
        usual,
        noise={name: share * usual[name] for name in names} if share else {},
        # The eddy currents' misfit is a share of the largest of all impedances
        tolerance={name: np.hypot(eddy_misfit * most[name], turned[name]) for name in names},
        findings=tuple(findings),
    )
