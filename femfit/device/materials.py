"""The library of materials: tables as in ``[materials]`` of an actuator file, which may name one or define its own."""

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from femfit.core.errors import ActuatorFileError
from femfit.device.bh import read_bh_csv
from femfit.device.complaints import meant_by, read_table
from femfit.device.keys import converted, keys_of
from femfit.device.parts import LinearMaterial, Material, NonlinearMaterial

KINDS = (LinearMaterial, NonlinearMaterial)


@dataclass(frozen=True)
class LibraryMaterial:
    """A material with its source."""

    material: Material
    reference: str  # Where the values come from, and what they leave out

    @property
    def table(self) -> dict[str, Any]:
        """The material as an actuator file would write it."""
        values = vars(self.material) | vars(self.material.thermal)
        keys = keys_of(type(self.material)).items()
        written = {name: converted(values.get(key.field), -key.power) for name, key in keys}
        lists = {name: list(value) for name, value in written.items() if isinstance(value, tuple)}
        return {name: value for name, value in (written | lists).items() if value is not None}


def _library() -> dict[str, LibraryMaterial]:
    """The entries of ``materials.toml``; the curves stand in the folder beside it, whose files repeat the source."""
    tables = tomllib.loads((files("femfit.device") / "materials.toml").read_text(encoding="utf-8"))
    library, problems = {}, list[str]()
    for name, own in tables.items():
        table = tables.get(own.pop("like", ""), {}) | own
        reference, curve = table.pop("reference"), table.pop("bh_curve", None)
        points, wrong = (None, []) if curve is None else read_bh_csv(Path(__file__).parent / curve)
        table |= {} if points is None else dict(zip(("B_T", "H_A_per_m"), map(list, points), strict=True))
        problems += wrong
        library[name] = LibraryMaterial(read_table(meant_by(table, KINDS), table, name, problems, name=name), reference)
    if problems:
        raise ActuatorFileError("materials.toml", problems)
    return library


LIBRARY: dict[str, LibraryMaterial] = _library()
"""By name, as written in actuator files."""
