"""``femfit new``: a commented drawing to start from."""

import json
from pathlib import Path
from typing import Annotated, Literal

from femfit.cli.command import OUTPUT
from femfit.core.errors import OutputError, UsageError
from femfit.core.files import write_text

Kind = Literal["ball", "bearing", "levitation", "magnet-pair", "pot-magnet", "relay", "solenoid", "voice-coil"]


def new(kind: Kind | None = None, *, schema: bool = False, output: Annotated[Path | None, OUTPUT] = None) -> None:
    """Write a commented drawing to start from: a solenoid, a voice coil, a bearing ...

    Parameters
    ----------
    kind : str
        Kind of actuator that is nearest to yours.
    schema : bool
        JSON Schema of actuator files instead, by which an editor completes keys and says what each wants.
    output : Path
        File to write, which must not be there yet; KIND.toml or actuator-schema.json by default.
    """
    from femfit.device.load import starter_text
    from femfit.device.schema import json_schema

    if (kind is None) != schema:
        raise UsageError("Give a kind of actuator, such as solenoid, or --schema alone.")
    path = output or Path(f"{kind}.toml" if kind else "actuator-schema.json")
    if path.suffix != (end := ".toml" if kind else ".json"):
        raise OutputError(f"The file must end in {end}; instead received {path}. Give for example -o mine{end}.")
    if path.exists():
        raise OutputError(f"{path} is there already. Give another name with -o, or remove it.")
    write_text(path, starter_text(kind, path.stem) if kind else json.dumps(json_schema(), indent=1))
    print(f"written: {path}")
    if kind:
        print(f"See it:  femfit view {path} -o {path.stem}.png\nRun it:  femfit run {path}")
