"""Records of a levitated body: held, reproducible, and with effects of the size that was asked for."""

import numpy as np
import pytest

from femfit.device.load import read_actuator
from femfit.field.sweep import run_sweep
from femfit.fit.build import fit_model
from femfit.model.json_file import read_model, write_model
from femfit.tables.measurement_file import read_measurement
from support.trial_study.campaign.case import Order
from support.trial_study.levitated_body import Body, MovingTruth
from support.trial_study.record import Recorder, closed_loop
from support.trial_study.series_case import make_series_case, sizing_record

ORDER = Order(3, "emaws-rig", ("viscous_friction",), 1.0, 2)


@pytest.fixture(scope="module")
def rig_model(trial_directory, rig_truth):
    path = trial_directory / "tables" / f"{rig_truth.actuator.name}.json"
    if not path.exists():
        sweep = run_sweep(read_actuator(trial_directory / "rig.toml"), trial_directory / "tables" / "sweep", workers=1)
        write_model(fit_model(sweep).model, path)
    return read_model(path)


def test_the_loop_holds_the_body_at_its_reference(rig_truth, rig_model):
    body = Body(rig_truth.actuator.mechanics.mass_kg)
    recorder = Recorder(2, 400, {}, (0.024,))
    path = closed_loop(MovingTruth(rig_truth, body), rig_model, recorder, np.random.default_rng(1))
    # a fifth state of the filter takes out the Hall bias; what is left is dither and sensor noise
    assert np.abs(path.state[200:, :, 0] - 0.024).mean() < 0.5e-3
    assert path.state[:, :, 1].std() > 1e-3


def test_a_recorded_case_is_reproducible_and_of_the_size_that_was_asked_for(rig_truth, rig_model, tmp_path):
    sized = sizing_record(rig_truth, rig_model)
    first, again = (make_series_case(rig_truth, rig_model, ORDER, sized) for _ in range(2))
    assert first.rows.equals(again.rows)
    assert max(first.key["effects"][0]["over_noise"].values()) == pytest.approx(1.0, rel=0.05)
    first.rows.to_csv(tmp_path / "data.csv", index=False)
    series = read_measurement(tmp_path / "data.csv")
    assert {"voltage_V", "current_A", "distance_m"} <= set(series.given)
    assert first.unseen["run"].nunique() == 1
