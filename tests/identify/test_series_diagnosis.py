"""Records of a closed loop around an unstable plant: clean ones name nothing, hidden effects are found in them."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import TableError
from femfit.device.electrics import PositionSensor
from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import Whitening, chains_of
from femfit.identify.series.observations import series_observations
from femfit.identify.series.samples import take_samples
from femfit.model.with_effects import with_effects
from femfit.tables.measurement_file import read_measurement
from support.closed_loop import closed_loop, recorded

QUICK = {"bootstrap": 0}


def added(name, **parameters):
    effect = effect_by_name(name)
    return AddedEffect(effect, effect.null() | parameters)


@pytest.fixture(scope="module")
def model(levitation_model):
    """With a controller half as fast, so that the loops take half as long."""
    return replace(levitation_model, sample_time_s=1e-3)


@pytest.fixture(scope="module")
def clean(model):
    return closed_loop(model, runs=12, seconds=2.5, seed=7)


def hidden(model, *effects):
    return recorded(closed_loop(model, effects, seconds=2.0, seed=3))


def test_balances_of_an_undisturbed_record_close_far_below_what_effects_do(model, clean):
    observations = series_observations(model, recorded(clean, distance_m=0.0, current_A=0.0))
    assert observations.channels == ("force_balance_N", "voltage_balance_V", "hall_V")
    force, volts = (observations.residual[observations.of(name)] for name in observations.channels[:2])
    # Of 0.043 N and 3 V: the windows' own error beside the kinks that a held command makes
    assert np.sqrt(np.mean(force**2)) < 5e-5 * 0.043
    assert np.sqrt(np.mean(volts**2)) < 5e-6 * 3.0


def test_the_voltage_of_an_inductance_in_series_is_balanced_too(model):
    coil = replace(model, circuits=(replace(model.circuit, inductance_H=0.02),))  # as much as the winding's own
    samples = closed_loop(coil, seconds=1.0)
    for gain_error in (0.0, 0.1):
        read = samples.assign(current_A=samples["current_A"] / (1.0 + gain_error))
        observations = series_observations(coil, recorded(read, distance_m=0.0, current_A=0.0))
        left = observations.value - observations.predict([added("current_gain", gain_error=gain_error)])
        assert np.sqrt(np.mean(left[observations.of("voltage_balance_V")] ** 2)) < 2e-5 * 3.0


@pytest.mark.parametrize("how", [{}, {"lost": 0.02}, {"converter_A": 5e-3}, {"distance_m": 3e-5, "current_A": 4e-3}])
def test_the_scatter_of_the_balances_is_what_the_sensors_noise_makes(model, clean, how):
    observations = series_observations(model, recorded(clean, seed=1, runs=range(1, 7), **how))
    for name in observations.channels:
        rms = float(np.sqrt(np.mean(observations.residual[observations.of(name)] ** 2)))
        # Some 360 windows: 4 %; a converter's error is no white noise and is bounded from above
        low = 0.6 if "converter_A" in how else 0.85
        assert low < rms / observations.declared_noise[name] < 1.15


# The gate opens on 1 % of clean campaigns: two openings are less likely than 0.1 % among four, and 1 % among twelve
@pytest.mark.parametrize("records", [4, pytest.param(12, marks=pytest.mark.long)])
def test_clean_records_name_nothing_though_the_hall_noise_is_fed_back(model, clean, records):
    ways = [{}, {"lost": 0.02}, {"converter_A": 5e-3, "current_A": 3e-4}, {"distance_m": 3e-5, "current_A": 4e-3}]
    verdicts = [
        diagnose(model, recorded(clean, seed=run, runs=(run,), **ways[run % 4]), **QUICK).verdict
        for run in range(1, records + 1)
    ]
    assert verdicts.count("nothing_missing") >= records - 1
    assert "named" not in verdicts


def test_many_clean_runs_together_show_no_structure_in_any_channel(model, clean):
    # A Hall element's noise drives the current that follows it: settings must be taken from before a reading
    observations = series_observations(model, recorded(clean, seed=2, runs=range(1, 13)))
    noise = estimate_noise(observations)
    whitening = Whitening(observations, noise, chains_of(observations))
    test = pattern_space(observations, whitening).test(whitening.full(observations.residual))
    assert test.p_value > 0.01


@pytest.mark.long
def test_forty_long_clean_records_are_called_clean_but_for_chance(model):
    samples = closed_loop(model, runs=40, seconds=8.0, seed=11)
    generator = np.random.default_rng(0)
    verdicts = []
    for run in range(1, 41):
        how = {
            "distance_m": 10.0 ** generator.uniform(-6.0, -4.5),
            "current_A": 10.0 ** generator.uniform(-3.5, -2.2),
            "lost": float(generator.choice([0.0, 0.02])),
            "converter_A": float(generator.choice([0.0, 5e-3])),
        }
        verdicts.append(diagnose(model, recorded(samples, run, runs=(run,), **how), **QUICK).verdict)
    assert verdicts.count("nothing_missing") >= 38  # 1 % each: three among forty are less likely than 1 %


@pytest.mark.parametrize(
    ("effect", "key", "rel"),
    [
        (added("viscous_friction", damping_per_s=6.0), "damping_per_s", 0.2),
        pytest.param(added("motional_emf", share=1.0), "share", 0.3, marks=pytest.mark.long),
        pytest.param(added("core_saturation", mmf_loss_3=0.04), "mmf_loss_3", 0.3, marks=pytest.mark.long),
        (added("driver_gain", gain_error=0.03), "gain_error", 0.05),
    ],
    ids=lambda value: value.effect.name if isinstance(value, AddedEffect) else None,
)
def test_a_hidden_effect_is_in_the_class_with_its_size(model, effect, key, rel):
    result = diagnose(model, hidden(model, effect), **QUICK)
    assert result.verdict == "named"
    assert effect.effect.name in result.missing[0].members
    if result.missing[0].name == effect.effect.name:
        assert result.missing[0].parameters[key] == pytest.approx(effect.parameters[key], rel=rel)


def test_mass_and_pull_are_one_class_in_a_closed_loop(model):
    result = diagnose(model, hidden(model, added("mass_error", mass_error=0.03)), **QUICK)
    assert {"mass_error", "constant_force"} <= set(result.missing[0].members)
    assert result.where.channel == "force_balance_N"


def test_a_heavier_body_is_not_charged_with_the_noise_of_its_acceleration(model):
    samples = closed_loop(model, [added("mass_error", mass_error=0.2)], runs=6, seconds=2.5, seed=5)
    result = diagnose(model, recorded(samples, seed=3, runs=range(1, 7), distance_m=3e-5), **QUICK)
    assert result.missing[0].name == "mass_error"
    assert result.missing[0].parameters["mass_error"] == pytest.approx(0.2, rel=0.02)
    # Weighed by the true mass, the noise of the distance would leave a fifth more
    fall = {one.channel: one for one in result.error_fall.channels}
    assert 0.74 < fall["force_balance_N"].after_over_noise < 1.08  # 30 windows: 13 %, two of them below one


def test_an_eddy_lag_is_separated_from_friction_by_the_voltage_and_hardly_by_the_motion_alone(model):
    record = hidden(model, added("eddy_current_lag", ring_share=0.15, time_s=4e-3))
    blind = replace(
        record,
        rows=record.rows.assign(voltage_V=np.nan, hall_V=np.nan),
        given=tuple(name for name in record.given if name not in ("voltage_V", "hall_V")),
    )
    assert series_observations(model, blind).channels == ("force_balance_N",)
    whole, motion = (diagnose(model, one, **QUICK) for one in (record, blind))
    assert whole.missing[0].members == ("eddy_current_lag",)
    falls = [{one.name: one.chi2_fall for one in result.ranking} for result in (whole, motion)]
    shares = [fall["viscous_friction"] / fall["eddy_current_lag"] for fall in falls]
    # A body that follows slowly needs a current that changes with its speed, so that a lag pulls like friction
    assert shares[0] < 0.25
    assert shares[1] > 0.5
    assert "viscous_friction" in motion.look_alikes
    assert not motion.confident


def test_effects_that_a_model_has_are_taken_into_account(model):
    effect = added("viscous_friction", damping_per_s=6.0)
    result = diagnose(with_effects(model, [effect]), hidden(model, effect), **QUICK)
    assert result.verdict == "nothing_missing"


def test_a_record_from_a_file_is_diagnosed_like_one_in_memory(model, clean, tmp_path):
    record = recorded(clean)
    record.rows.drop(columns="segment").to_csv(tmp_path / "record.csv", index=False, float_format="%.12g")
    read = read_measurement(tmp_path / "record.csv")
    assert read.findings == ()
    first, second = (series_observations(model, one) for one in (record, read))
    np.testing.assert_allclose(second.residual, first.residual, atol=1e-9)


def test_a_record_without_a_distance_is_told_of_the_position_sensors_volts(model, clean):
    record = recorded(clean)
    without = replace(record, given=tuple(name for name in record.given if name != "distance_m"))
    laser = PositionSensor(name="laser", distances_m=(0.0, 0.1), readings=(0.5, 80.5), unit="V")
    with pytest.raises(TableError, match=r"--column HEADER=position_V"):
        series_observations(replace(model, other_sensors=(laser,)), without)
    with pytest.raises(TableError) as refused:
        series_observations(model, without)
    assert "position_V" not in str(refused.value)


def test_records_that_cannot_be_balanced_are_refused_with_the_remedy(model, clean):
    record = recorded(clean)
    without = replace(record, given=tuple(name for name in record.given if name != "distance_m"))
    with pytest.raises(TableError, match="lacks distance_m"):
        series_observations(model, without)
    millimetres = replace(record, rows=record.rows.assign(distance_m=1e3 * record.rows["distance_m"]))
    with pytest.raises(TableError, match="distance_m seems to be in mm"):
        series_observations(model, millimetres)
    short = replace(record, rows=record.rows.iloc[:20])
    with pytest.raises(TableError, match="without a gap"):
        series_observations(model, short)


def test_readings_at_an_end_of_an_output_without_a_converter_count_as_missing(model, clean):
    """Without steps a limited output stands next to its end, not on it."""
    analogue = replace(model, sensor=replace(model.sensor, adc_bits=0))
    series = recorded(clean, runs=range(1, 2))
    volts = series.rows["hall_V"]
    limited = np.minimum(volts + 4.999 - volts.median(), 4.999)
    samples = take_samples(analogue, replace(series, rows=series.rows.assign(hall_V=limited)))
    assert np.isnan(samples.columns["hall_V"][limited == 4.999]).all()
    assert np.isfinite(take_samples(analogue, series).columns["hall_V"]).all()
    assert "clipped" in {finding.code for finding in samples.findings}


def test_a_record_that_can_show_none_of_the_effects_considered_is_unexplained(model):
    others = [name for name in all_effects() if name != "flux_integrator_drift"]  # no record has the flux linkage
    found = diagnose(model, hidden(model, added("mass_error", mass_error=0.05)), exclude=others, **QUICK)
    assert found.verdict == "unexplained"
