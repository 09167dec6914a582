"""``femfit sense``: how well sensors tell the distance without a sensor of position."""

from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number


def sense(
    model: Path,
    *,
    sensors: str = "current",
    voltage: float | None = None,
    drive: Path | None = None,
    test_voltage: Annotated[float, Parameter(validator=Number(gte=0.0))] = 0.0,
    test_frequency_Hz: Annotated[float | None, Parameter(name="--test-frequency-Hz", validator=Number(gt=0.0))] = None,
    runs: Annotated[int, Parameter(validator=Number(gte=1))] = 20,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 1,
    picture: Path | None = None,
    csv: Path | None = None,
    json: Path | None = None,
) -> None:
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
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import conclude, status
    from femfit.core.files import PICTURE, REPLAYED, RESULT, require_outputs, write_text
    from femfit.simulation.sense import sense as sensed

    require_outputs([model], (picture, PICTURE), (csv, REPLAYED), (json, RESULT))
    with status("Simulating"):
        sensing = sensed(
            model,
            sensors=[name.strip() for name in sensors.split(",") if name.strip()],
            drive=drive,
            voltage_V=voltage,
            test_voltage_V=test_voltage,
            test_frequency_Hz=test_frequency_Hz,
            runs=runs,
            rng=seed,
        )
    written = []
    if picture is not None:
        from femfit.report.motion_figures import sense_figure
        from femfit.report.style import write_picture

        write_picture(partial(sense_figure, sensing), picture)
        written.append(picture)
    if csv is not None:
        write_text(csv, sensing.table.to_csv(index=False))
        written.append(csv)
    conclude(sensing, json, written)
