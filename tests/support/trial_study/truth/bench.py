"""A bench with hidden effects: what its sensors would read without noise."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.trial.field_table import Fields
from support.trial_study.truth.families import Truth


@dataclass(frozen=True, eq=False)
class Points:
    """Readings to be taken, n of them in the order of measuring, and what the bench is like then.

    Parameters
    ----------
    distance, current : array, shape (n,)
        That body and winding have, in m and A.
    run, order : array of int, shape (n,)
        Number of the run from 0, and place in the whole campaign.
    time_s : array, shape (n,)
        Since the start of the reading's run.
    branch : array, shape (n,)
        +1 rising, -1 falling current.
    coil_C, magnet_C, element_C : array, shape (n,)
        Temperatures.
    """

    distance: FloatArray
    current: FloatArray
    run: IntArray
    order: IntArray
    time_s: FloatArray
    branch: FloatArray
    coil_C: FloatArray
    magnet_C: FloatArray
    element_C: FloatArray


Channels = Mapping[str, FloatArray]
Setting = Callable[[float, Points], tuple[FloatArray, FloatArray]]
FieldChange = Callable[[float, Points], Fields]
Reading = Callable[[float, Channels, Points], Channels]


@dataclass(frozen=True, eq=False)
class Hidden:
    """One effect as the bench has it, up to its size.

    Parameters
    ----------
    typical, limit : float
        Usual size, and the largest that is still believable, in ``unit``.
    setting : callable or None
        (size, points) -> (distance, current) that body and winding really have.
    fields : callable or None
        (size, points) -> change of the fields.
    reading : callable or None
        (size, channels, points) -> channels as read.
    """

    name: str
    typical: float
    limit: float
    unit: str
    setting: Setting | None = None
    fields: FieldChange | None = None
    reading: Reading | None = None
    constants: Mapping[str, float] = field(default_factory=dict)


def true_readings(truth: Truth, points: Points, effects: Sequence[tuple[Hidden, float]] = ()) -> dict[str, FloatArray]:
    """What the sensors would read without noise.

    Returns
    -------
    dict of str to array, each of shape (n,)
        ``hall_V`` only with a Hall element. The element's range is not clipped here: the converter does it.
    """
    for hidden, size in effects:
        if hidden.setting is not None:
            distance, current = hidden.setting(size, points)
            points = replace(points, distance=distance, current=current)
    fields = truth.base.at(points.distance, points.current)
    for hidden, size in effects:
        if hidden.fields is not None:
            fields += hidden.fields(size, points)
    values: dict[str, FloatArray] = {
        "force_N": fields.force,
        "flux_linkage_Wb": fields.flux_linkage,
        "voltage_V": truth.actuator.coil.resistance_ohm * points.current,
    }
    element = truth.actuator.hall
    if element is not None:
        values["hall_V"] = element.quiescent_V + element.sensitivity_V_per_T * fields.hall
    for hidden, size in effects:
        if hidden.reading is not None:
            values |= hidden.reading(size, values, points)
    return {name: np.asarray(value) for name, value in values.items()}
