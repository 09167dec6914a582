"""``femfit new``: a commented drawing to start from."""

import re
from pathlib import Path
from typing import Annotated, Literal

from femfit.cli.command import OUTPUT
from femfit.core.errors import OutputError
from femfit.core.files import write_text

Kind = Literal["ball", "bearing", "levitation", "magnet-pair", "pot-magnet", "relay", "solenoid", "voice-coil"]


def new(
    kind: Kind,
    *,
    output: Annotated[Path | None, OUTPUT] = None,
) -> None:
    """Write a commented actuator file that runs, to change into a drawing of your own.

    Parameters
    ----------
    kind : str
        Kind of actuator that is nearest to yours.
    output : Path
        File to write, which must not be there yet; KIND.toml by default.
    """
    from femfit.device.load import starter_text
    from femfit.device.schema import NAME_PATTERN

    path = output or Path(f"{kind}.toml")
    if path.suffix != ".toml":
        raise OutputError(f"The file must end in .toml; instead received {path}. Give for example -o mine.toml.")
    if path.exists():
        raise OutputError(f"{path} is there already. Give another name with -o, or remove it.")
    title = path.stem if re.match(NAME_PATTERN, path.stem) else None
    write_text(path, starter_text(kind, title))
    print(f"written: {path}")
    print(f"See it:  femfit view {path} -o {path.stem}.png")
    print(f"Run it:  femfit run {path}")
