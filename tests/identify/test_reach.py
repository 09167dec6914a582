"""A bench table without any row where the model holds is refused with the reason."""

from dataclasses import replace

import pytest

from femfit.core.errors import TableError
from femfit.identify.readings.bench import bench_observations
from support.campaign import campaign


def test_a_table_in_millimetres_is_refused_with_its_unit(levitation_model):
    table = campaign(levitation_model, 21, runs=1)
    table = replace(table, rows=table.rows.assign(distance_m=1e3 * table.rows["distance_m"]))
    with pytest.raises(
        TableError, match=r"must have rows within the model's validity domain, .*distance_m seems to be in mm"
    ):
        bench_observations(levitation_model, table)


def test_a_table_of_other_distances_is_refused_with_both_ranges(levitation_model):
    table = campaign(levitation_model, 21, runs=1)
    box = levitation_model.validity
    far = replace(table, rows=table.rows.assign(distance_m=1.5 * box.distance_max_m))
    with pytest.raises(TableError) as caught:
        bench_observations(levitation_model, far)
    assert f"{box.distance_min_m:g} to {box.distance_max_m:g} m" in str(caught.value)
    assert f"its distances are {1.5 * box.distance_max_m:g}" in str(caught.value)
    assert "seems" not in str(caught.value)
