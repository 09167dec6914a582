"""``femfit sense``: how well sensors tell the distance without a sensor of position."""

from functools import partial
from pathlib import Path
from typing import Annotated

import femfit as ff
from femfit.cli.command import AT_LEAST_ONE, NOT_NEGATIVE, POSITIVE, Outcome, ToWrite, Writes, command, names_of
from femfit.core.files import PICTURE, REPLAYED, write_text


@command()
def sense(
    model: Path,
    *,
    sensors: str = "current",
    voltage: float | None = None,
    drive: Path | None = None,
    test_voltage: Annotated[float, NOT_NEGATIVE] = 0.0,
    test_frequency_Hz: Annotated[float | None, POSITIVE] = None,
    runs: Annotated[int, AT_LEAST_ONE] = 20,
    seed: Annotated[int, NOT_NEGATIVE] = 1,
    picture: Annotated[Path | None, Writes(PICTURE)] = None,
    csv: Annotated[Path | None, Writes(REPLAYED)] = None,
) -> Outcome:
    """How well the current, or other sensors, tell the distance: error in simulation, and bound.

    Parameters
    ----------
    model : Path
        Model file with circuit, motion and the sensors.
    sensors : str
        Names of the sensors that the filter reads, or their kinds (current, position), with commas.
    voltage : float
        Height of the command's step in V, after 20 ms of rest; default: the supply's largest voltage.
    drive : Path
        Table with the columns time_s and voltage_V in place of that step.
    test_voltage : float
        Amplitude in V of a square wave on top of the command.
    test_frequency_Hz : float
        Frequency in Hz of the square wave; default: a twentieth of the sampling rate.
    runs : int
        Number of simulated runs, each with its own noise.
    seed : int
        Seed of the noise.
    picture : Path
        PNG, SVG or PDF with the motion, the filter's error and its bound.
    csv : Path
        File for time, distance, the filter's error, what it claims, and the bound.
    """
    from femfit.cli.output import status
    from femfit.report.style import write_picture

    with status("Simulating"):
        sensing = ff.sense(
            model,
            sensors=list(names_of(sensors)),
            drive=drive,
            voltage_V=voltage,
            test_voltage_V=test_voltage,
            test_frequency_Hz=test_frequency_Hz,
            runs=runs,
            rng=seed,
        )
    files: list[ToWrite] = [
        (picture, partial(write_picture, sensing.plot)),
        (csv, lambda path: write_text(path, sensing.table.to_csv(index=False))),
    ]
    return Outcome(sensing, files=files)
