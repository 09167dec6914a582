"""Time of a whole diagnosis of forty thousand samples of closed loops with every effect that they can show."""

from dataclasses import replace
from statistics import median
from time import perf_counter, process_time

import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnose import diagnose
from support.closed_loop import closed_loop, recorded


@pytest.mark.benchmark
def test_forty_thousand_samples_with_all_effects(levitation_model):
    model = replace(levitation_model, sample_time_s=1e-3)
    friction = AddedEffect(effect_by_name("viscous_friction"), {"damping_per_s": 3.0})
    runs = 10
    record = recorded(closed_loop(model, [friction], runs=runs, seconds=4.0, seed=1), runs=range(1, runs + 1))
    for text, options in (
        ("named, with 40 clean records simulated", 40),
        ("named, without", 0),
    ):
        times, processor = [], []
        for _ in range(3):
            start, begun = perf_counter(), process_time()
            result = diagnose(model, record, bootstrap=options)
            times.append(perf_counter() - start)
            processor.append(process_time() - begun)
        scored = sum(not score.note for score in result.ranking)
        print(
            f"{len(record.rows)} samples, {scored} effects, {text}: {median(times):.1f} s, of the processor "
            f"{median(processor):.1f} s (60 s required)"
        )
        assert "viscous_friction" in result.missing[0].members
