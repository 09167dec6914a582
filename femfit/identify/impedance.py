"""Impedances of a bench table: how they are weighed, and which are read where the model's eddy currents hold.

An instrument's errors of resistance and reactance go with the magnitude |Z|. Readings, predictions and slopes are
multiplied by a magnitude that is usual over |Z| of each reading, so that a channel has one noise: by the winding's
resistance, and for an inductance by its own over |Z| / w.

Eddy currents beside iron that saturates were solved about a bias. Away from it the iron has another permeability, by a
factor that the model does not know. Skin layers go with the product of permeability and conductivity, so that the
impedance is off as if the iron conducted otherwise: by about x = |lambda(d, i) - lambda(d, b(d))| / lambda_s in the
logarithm, lambda_s a flux linkage that begins to saturate the iron. A solid lifting magnet of 1010 that was solved
about 2.5 and 3.0 A is off at 1.3 and 1.6 A by 0.44 and 0.46, where x is 0.47.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from femfit.core.numerics import BIAS_SHARE, BoolArray, FloatArray
from femfit.core.results import Finding
from femfit.core.sweep_columns import current_columns, resistance_column
from femfit.identify.constants import AWAY, FREQUENCY_SLACK, LEAST_LINKED, OF_THREE
from femfit.identify.words import finding
from femfit.model.actuator_model import ActuatorModel
from femfit.model.impedance import SHORTED
from femfit.model.readings import Point, readings_by
from femfit.tables.header import parts_of
from femfit.tables.impedance import SERIES
from femfit.tables.measurement import IMPEDANCE_SHARE


def near_bias(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> tuple[BoolArray, Finding | None]:
    """Which rows, at distances (N,) and currents (N,) or (N, n), are near the bias of eddy currents.

    A finding says of the others where they were read, and what to do.
    """
    base = model.without_effects
    bias = base.eddy.bias if base.eddy else None
    if bias is None:
        return np.ones(len(distance), dtype=bool), None
    here, there = current.reshape(len(distance), -1), bias.at(distance)
    read, solved = (base.magnetics.flux_linkage(distance, currents) for currents in (here, there))
    apart = np.minimum(*(np.linalg.norm(read - sign * solved, axis=1) for sign in (1.0, -1.0)))  # all turned is alike
    ends = np.array(np.meshgrid(*base.validity.current_limits_A)).reshape(here.shape[1], -1).T
    linked = [base.magnetics.flux_linkage(distance, np.tile(end, (len(distance), 1))) for end in ends]
    away = np.asarray(apart > AWAY * BIAS_SHARE * np.linalg.norm(linked, axis=-1).max())
    if not away.any():
        return ~away, None
    least = [float(f"{median:.3g}") for median in np.median(here[away], axis=0)]
    facts: dict[str, Any] = {"asked": least[0] if len(least) == 1 else least, "rows": int(away.sum())}
    facts["circuits"] = [parts_of(name)[1] for name in current_columns(model.current_names)]
    for name, currents in (("read", here[away]), ("held", there[away])):
        facts[name] = list(zip(currents.min(axis=0).tolist(), currents.max(axis=0).tolist(), strict=True))
    return ~away, finding("eddy-bias", "current_A", float(away.sum()), **facts)


@dataclass(frozen=True, eq=False)
class Weighing:
    """How readings of each channel are weighed; empty where they are no impedances."""

    weight: Mapping[str, FloatArray] = field(default_factory=dict)  # Of every row, shape (N,), by channel
    magnitude: Mapping[str, float] = field(default_factory=dict)  # At which a channel's readings are given, in its unit
    noise: Mapping[str, float] = field(default_factory=dict)  # Declared as a share of |Z|
    tolerance: Mapping[str, FloatArray] = field(default_factory=dict)  # Of the model's eddy currents, of every row
    findings: tuple[Finding, ...] = ()


def weighed_by_magnitude(point: Point, channels: Collection[str], declared: Mapping[str, float]) -> Weighing:
    """The weights of impedances, by the model's own magnitude; of a channel with a noise in its unit they are 1."""
    names = [name for name in channels if parts_of(name)[0] in SERIES and name not in declared]
    nominal, frequency, eddy = point.conditions.nominal, np.asarray(point.conditions.frequency_Hz), point.model.eddy
    if not names or not np.isfinite(frequency).all():
        return Weighing()
    read = {name: values for name, (values,) in readings_by(point, (), SERIES).items()}
    w = 2.0 * np.pi * frequency
    magnitude = {
        name: np.hypot(read.get(resistance_column(name), 0.0), w * values)
        for name, values in read.items()
        if parts_of(name)[0] == "inductance_H"
    }
    largest = np.max(list(magnitude.values()), axis=0)
    size, most = {}, {}
    for name, z in magnitude.items():
        off = largest * (OF_THREE if name.endswith(SHORTED) else 1.0)
        for channel, scale in ((resistance_column(name), 1.0), (name, w)):
            size[channel], most[channel] = np.maximum(z, LEAST_LINKED * largest) / scale, off / scale
    quantity = {name: parts_of(name)[0] for name in names}
    usual = {name: float(getattr(nominal, of)) for name, of in quantity.items()}
    findings = [finding("weighed", usual=list({of: usual[name] for name, of in quantity.items()}.items()))]
    share, misfit = declared.get(IMPEDANCE_SHARE), 0.0
    if eddy is not None and eddy.error is not None:
        misfit, held = (eddy.error.impedance or 0.0) / np.sqrt(3.0), eddy.error.frequency_max_Hz  # evenly spread
        if beyond := int((frequency > (1.0 + FREQUENCY_SLACK) * held).sum()):  # not held against the field there
            facts = {"beyond": beyond, "held": held, "highest": float(frequency.max())}
            findings.append(finding("frequency-range", "frequency_Hz", float(beyond), "", **facts))
    return Weighing(
        {name: usual[name] / size[name] for name in names},
        usual,
        noise={name: share * usual[name] for name in names} if share else {},
        # The eddy currents' misfit is a share of the largest of all impedances
        tolerance={name: misfit * most[name] for name in names},
        findings=tuple(findings),
    )
