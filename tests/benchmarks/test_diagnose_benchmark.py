"""Time of a whole diagnosis of a thousand rows with every effect that a bench can show."""

from statistics import median
from time import perf_counter

import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnose import diagnose
from support.campaign import campaign


@pytest.mark.benchmark
def test_a_thousand_rows_with_all_effects(levitation_model):
    saturation = effect_by_name("core_saturation")
    hidden = [AddedEffect(saturation, saturation.null() | {"mmf_loss_6": 0.02})]
    table = campaign(levitation_model, 1, hidden, distances=15, currents=11)
    for text, options in (
        ("named, with 40 clean campaigns simulated", 40),
        ("named, without", 0),
    ):
        times = []
        for _ in range(3):
            start = perf_counter()
            result = diagnose(levitation_model, table, bootstrap=options)
            times.append(perf_counter() - start)
        scored = sum(not score.note for score in result.ranking)
        print(f"{len(table.rows)} rows x 4 channels, {scored} effects, {text}: {median(times):.1f} s (10 s required)")
        assert result.missing[0].name == "core_saturation"
