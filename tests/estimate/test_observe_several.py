"""Records through filters: of a bearing with two circuits, and of magnets alone."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Stop
from femfit.estimate.holding import holding_currents
from femfit.estimate.observe import observe
from femfit.fit.build import fit_model
from femfit.report.motion_figures import replay_figure
from support.bearing import ENTRY, table_of
from support.eddies import magnets_alone
from support.readings import LASER
from support.steps import runge_kutta_step

STEP_S = 0.5e-3


@pytest.fixture(scope="module")
def bearing():
    """Nothing reads its upper current by a sensor of the drawing; the record does."""
    gap = {"kind": "position", "name": "gap", "noise": 1e-7, "distances_m": [0, 1], "readings": [0, 1], "unit": "m"}
    model = fit_model(table_of(entry={**ENTRY, "sensors": [gap]})).model
    bridges = tuple(replace(one, voltage_min_V=-24.0, drive=Drive()) for one in model.circuits)
    return replace(model, circuits=bridges, sample_time_s=1e-4)


@pytest.fixture(scope="module")
def bearing_record(bearing, tmp_path_factory):
    """Held for a hundredth of a second by a differential current, with a bias of 1 A."""
    generator, step = np.random.default_rng(4), 1e-4
    hold = holding_currents(bearing, 0.5e-3, np.array([1.0, 1.0]))
    state, rows = np.array([[0.5e-3, 0.0, *hold]]), []
    for k in range(300):
        wanted = 3e3 * (state[0, 0] - 0.5e-3) + 3.0 * state[0, 1]
        error = hold + np.array([wanted, -wanted]) - state[0, 2:]
        volts = np.clip(bearing.resistances_ohm * hold + 40.0 * error + generator.normal(size=2), -24.0, 24.0)
        read = [state[0, 0] + 1e-7 * generator.normal(), *(state[0, 2:] + 2e-3 * generator.normal(size=2))]
        rows.append([k * step, *volts, *read])
        state = runge_kutta_step(bearing, state, volts[None], step, 2)
    columns = ["time_s", "voltage_lower_V", "voltage_upper_V", "distance_m", "current_lower_A", "current_upper_A"]
    path = tmp_path_factory.mktemp("records") / "bearing.csv"
    pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
    return path


def test_a_bearing_is_followed_by_gap_and_currents(bearing, bearing_record):
    assert observe(bearing, bearing_record, find=False).sensors == ("gap",)  # that of the drawing
    sensors = ("gap", "current_lower", "current_upper")  # those that the record alone has, too
    seen = observe(bearing, bearing_record, filter=("ukf", "ekf"), sensors=sensors)
    assert len(replay_figure(seen).axes) == 3
    for one in seen.filters:
        assert one.lost_at_s is None
        assert one.built.process.names[2:] == ("current_lower_A", "current_upper_A")
    found = {one.name: one for one in seen.noise.estimates}
    for name in ("current_lower", "current_upper"):
        assert found[name].low < 2e-3 < found[name].high


def test_a_circuit_is_named_whose_voltage_is_missing_or_commanded_beyond_its_supply(bearing, bearing_record, tmp_path):
    rows = pd.read_csv(bearing_record).drop(columns="voltage_upper_V")
    rows.to_csv(tmp_path / "lacking.csv", index=False)
    with pytest.raises(TableError, match="voltage_upper_V"):
        observe(bearing, tmp_path / "lacking.csv")
    rows = pd.read_csv(bearing_record)
    rows.loc[50:60, "voltage_upper_V"] = 40.0
    rows.to_csv(tmp_path / "beyond.csv", index=False)
    said = [one.text for one in observe(bearing, tmp_path / "beyond.csv", find=False).findings if "beyond" in one.text]
    assert len(said) == 1
    assert "upper" in said[0]


def test_magnets_alone_need_no_voltage(levitation_model, tmp_path):
    stop = replace(levitation_model.motion, far_stop=Stop(0.0445))  # beyond the way of its fall
    model = replace(magnets_alone(levitation_model), other_sensors=(LASER,), sample_time_s=STEP_S, motion=stop)
    generator, state, read = np.random.default_rng(5), np.array([[0.03, 0.0]]), []
    for _ in range(100):
        read.append(state[0, 0] + 2e-5 * generator.normal())
        state = runge_kutta_step(model, state, np.zeros((1, 0)), STEP_S)
    path = tmp_path / "fall.csv"
    pd.DataFrame({"time_s": STEP_S * np.arange(100), "distance_m": read}).to_csv(path, index=False)
    seen = observe(model, path)
    assert seen.filters[0].trusted
    assert seen.noise is None or all(one.name != "voltage" for one in seen.noise.estimates)
