"""``femfit heat``: how warm winding and magnet become, what that costs, and which current may last."""

from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import Outcome, command
from femfit.cli.keywords import Keywords

_OPTIONS = Keywords(
    "femfit.heat.find_temperatures:find_temperatures", "current_A voltage_V=voltage distance_m=distance-mm"
)


@command("File for the result as JSON, with the thermal network.")
def heat(actuator: Path, *, options: Annotated[dict[str, Any], _OPTIONS]) -> Outcome:
    """How warm winding and magnet become, and which current may last.

    Parameters
    ----------
    actuator : Path
        Actuator file (.toml), whose table [thermal] says what surrounds the actuator.
    """
    return Outcome(ff.find_temperatures(actuator, **options))
