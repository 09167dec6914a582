"""What the library takes for a model and for effects, and what it refuses."""

import pytest

from femfit.core.errors import DomainError, FemfitError, ModelFileError, TableError, UsageError
from femfit.identify.comparison.compare import compare
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.experiments.suggest import suggest
from femfit.identify.refit.add_effects import add_effects
from femfit.model.json_file import write_model

BENCH = "run,current_A,distance_m,force_N\n" + "".join(
    f"1,{i},{d},{0.02 + 0.05 * i + k * 1e-4}\n" for k in range(3) for i in (0.2, 0.4, 0.8) for d in (0.02, 0.03, 0.04)
)


@pytest.fixture
def files(levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    (tmp_path / "bench.csv").write_text(BENCH)
    return str(tmp_path / "model.json"), tmp_path / "bench.csv"


def test_a_model_may_be_given_by_its_file(levitation_model, files):
    model, bench = files
    assert str(compare(model, bench)) == str(compare(levitation_model, bench))
    found, same = (diagnose(one, bench, bootstrap=0) for one in (model, levitation_model))
    assert found.verdict == same.verdict
    assert suggest(model, bench, found).explanations == suggest(levitation_model, bench, same).explanations


def test_a_missing_model_file_is_named(files, tmp_path):
    with pytest.raises(FemfitError, match="absent"):
        add_effects(tmp_path / "absent.json", files[1], "friction")


def test_no_effect_to_add_is_refused_with_what_to_give(files):
    with pytest.raises(TableError, match="No effect"):
        add_effects(*files, [])


@pytest.mark.parametrize("count", [-1, 1.5, None])
def test_a_number_of_clean_campaigns_that_is_no_count_is_refused(count, files):
    with pytest.raises(TableError, match=str(count)):
        diagnose(*files, bootstrap=count)


def test_a_result_in_place_of_a_model_or_a_measurement_is_refused_by_its_name(levitation_model, files):
    comparison = compare(*files)
    with pytest.raises(ModelFileError, match="Comparison"):
        diagnose(comparison, None)
    for judge in (compare, diagnose, suggest):
        with pytest.raises(TableError, match="NoneType"):
            judge(levitation_model, None)
    with pytest.raises(TableError, match="Comparison"):
        add_effects(levitation_model, comparison, "friction")


def test_what_is_no_diagnosis_and_no_names_is_refused(files):
    comparison = compare(*files)
    with pytest.raises(TableError, match="Comparison"):
        suggest(*files, comparison)
    with pytest.raises(TableError, match="No effect"):
        add_effects(*files, comparison)


@pytest.mark.parametrize("rng", [-1, 1.5, "one"])
def test_what_is_no_seed_is_refused_before_anything_is_read(rng):
    with pytest.raises(DomainError, match=str(rng)):
        diagnose("absent.json", "absent.csv", rng=rng)


@pytest.mark.parametrize("part", ["coil_temperature_C", "magnet_temperature_C"])
def test_a_temperature_below_absolute_zero_is_refused(files, part):
    with pytest.raises(UsageError, match="-300 "):
        add_effects(*files, "friction", **{part: -300.0})
