"""Progress where standard error is no terminal: the end is told early, and then now and then."""

from time import sleep

import pytest

from femfit.cli import output
from femfit.cli import progress as progress_module
from femfit.cli.output import status
from femfit.cli.progress import duration, loop_progress, progress


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress_module, "monotonic", lambda: now[0])
    return now


def lines(capsys):
    return capsys.readouterr().err.splitlines()


def test_long_work_tells_its_end_with_the_first_result_and_then_every_ten_seconds(clock, capsys):
    with progress("sweep x", "points") as show:
        show(0, 100)
        for done in range(1, 101):
            clock[0] += 2.0
            show(done, 100)
    said = lines(capsys)
    assert said[0] == "sweep x: 1 of 100 points, about 3 min left"
    assert len(said) == 20


def test_work_of_a_few_seconds_prints_nothing(clock, capsys):
    with progress("sweep x", "points") as show:
        for done in range(11):
            show(done, 10)
            clock[0] += 0.5
    assert lines(capsys) == []


def test_what_an_interrupted_run_left_takes_no_time_of_this_one(clock, capsys):
    with progress("sweep x", "points") as show:
        show(90, 100)
        clock[0] = 5.0
        show(91, 100)
    assert lines(capsys) == [
        "sweep x: 90 of 100 points were there already",
        "sweep x: 91 of 100 points, about 45 s left",
    ]


def test_work_of_unknown_length_says_now_and_then_what_is_being_done(monkeypatch, capsys):
    monkeypatch.setattr(output, "INTERVAL_S", 0.01)
    with status("Reading") as say:
        sleep(0.2)
        say("Estimating the noise")
        sleep(0.2)
    said = lines(capsys)
    assert said[0] == "Reading, 1 s so far"
    assert said[-1] == "Estimating the noise, 1 s so far"
    assert len(said) == 2  # no line says again what the one before it said


def test_a_short_command_says_nothing_of_what_it_does(capsys):
    with status("Reading") as say:
        say("Estimating the noise")
    assert lines(capsys) == []


@pytest.mark.parametrize(("seconds", "text"), [(0.2, "1 s"), (89.0, "89 s"), (200.0, "3 min"), (9000.0, "2.5 h")])
def test_a_duration_is_said_as_one_would(seconds, text):
    assert duration(seconds) == text


def test_each_part_of_a_closed_loop_has_lines_of_its_own(clock, capsys):
    with loop_progress("valve") as show:
        show("closed loop", 0, 1000)
        clock[0] += 5.0
        show("closed loop", 100, 1000)
        show("trial 1", 0, 300)
        clock[0] += 20.0
        show("trial 1", 100, 300)
    first, second = capsys.readouterr().err.splitlines()
    assert first == "closed loop of valve: 100 of 1000 samples, about 45 s left"
    assert second == "trial 1 of valve: 100 of 300 samples, about 40 s left"
