"""What ``femfit run`` says of its stages, and of which devices it closes no loop."""

from dataclasses import replace
from pathlib import Path
from time import sleep

from femfit.cli import output
from femfit.cli.run import _close_loop, _Steps
from femfit.device.sensors import CurrentSensor, PositionSensor

SHUNT = CurrentSensor(name="shunt", circuit="coil", noise=0.004)
LASER = PositionSensor(name="laser", noise=4e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")


def studied(monkeypatch, model):
    """Whether a loop is simulated, and why not."""
    calls = []
    monkeypatch.setattr("femfit.simulation.study.closed_loop_study", lambda model, seed: calls.append(model))
    _, why = _close_loop(model, 1, Path("runs/valve/model.json"))
    return bool(calls), why


def test_no_loop_is_closed_where_no_sensor_reads_the_distance(monkeypatch, levitation_model):
    blind = replace(levitation_model, sensor=None, other_sensors=(SHUNT,))
    done, why = studied(monkeypatch, blind)
    assert not done
    assert "femfit simulate runs/valve/model.json" in why
    assert "shunt" in why
    for seeing in (levitation_model, replace(blind, other_sensors=(SHUNT, LASER))):
        assert studied(monkeypatch, seeing) == (True, "")


def test_a_long_stage_says_that_it_goes_on(monkeypatch, capsys):
    monkeypatch.setattr(output, "INTERVAL_S", 0.01)
    with _Steps().timed("rank laws"):
        sleep(0.2)
    assert capsys.readouterr().err.startswith("rank laws, ")
