"""Windows of a record whose body bounces: a path is not carried on through the stop that ended it."""

from dataclasses import replace

import numpy as np

import femfit as ff
from support.solenoids import solenoid
from support.switching import STEP_S, logged, switched

DISTANCE_M, FORCE_N = 2e-6, 0.02


def test_no_reading_is_compared_where_the_body_never_was():
    motion = solenoid().motion
    springy = replace(motion, near_stop=replace(motion.near_stop, restitution=0.6))
    device = replace(solenoid(springy), sample_time_s=STEP_S)
    loop = switched([0.0, 0.01, 0.11], [0.0, 12.0, 0.0], 0.17, model=device)
    assert sum(event.name == "hits_near" for event in loop.events) > 1
    record = logged([loop] * 4, noise=(5e-3, DISTANCE_M))
    force = np.tile(loop.table["force_N"], 4)
    rows = record.rows.assign(force_N=force + FORCE_N * np.random.default_rng(2).standard_normal(len(force)))
    compared = ff.compare(device, replace(record, rows=rows, given=(*record.given, "force_N"))).observations
    for name in ("force_balance_N", "voltage_balance_V", "force_N"):
        distance = compared.column("distance_m")[compared.of(name)]
        assert len(distance) > 40, name
        assert distance.min() >= rows["distance_m"].min(), name
        assert distance.max() <= rows["distance_m"].max(), name
    # Neither the impact nor what came before it is in a mean of the force: what is left is the sensor's noise
    here = compared.of("force_N")
    assert np.abs(compared.value - compared.base)[here].max() < 1.5 * FORCE_N
