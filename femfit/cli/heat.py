"""``femfit heat``: how warm winding and magnet become, what that costs, and which current may last."""

from pathlib import Path

import femfit as ff
from femfit.cli.command import Outcome, command


@command("File for the result as JSON, with the thermal network.")
def heat(
    actuator: Path,
    *,
    current_A: tuple[float, ...] = (),
    voltage: tuple[float, ...] = (),
    distance_mm: float | None = None,
) -> Outcome:
    """How warm winding and magnet become: hot resistance, remanence, time, and the largest current that may last.

    Parameters
    ----------
    actuator : Path
        Actuator file (.toml), whose table [thermal] says what surrounds the actuator.
    current_A : tuple of float
        Held current in A (rms where it alternates), once for each circuit; default: the most that the supply gives.
    voltage : tuple of float
        Held voltage in V in place of a current, once for each circuit.
    distance_mm : float
        Distance in mm at which the moving part is held; default: the first reference distance, or the shortest that it
        can have.
    """
    temperatures = ff.find_temperatures(
        actuator,
        current_A=current_A or None,
        voltage_V=voltage or None,
        distance_m=None if distance_mm is None else 1e-3 * distance_mm,
    )
    return Outcome(temperatures)
