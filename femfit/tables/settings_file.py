"""Small TOML and JSON files of settings beside a table: sidecars and manifests."""

import json
import math
import tomllib
from pathlib import Path
from typing import Any

from femfit.core.errors import TableError
from femfit.core.quoted import quoted


def read_settings(file: Path, example: str) -> dict[str, Any]:
    """Read a small TOML or JSON file of settings."""
    try:
        text = file.read_text(encoding="utf-8")
        data = tomllib.loads(text) if file.suffix == ".toml" else json.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        kind = "TOML" if file.suffix == ".toml" else "JSON"
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else quoted(error, 200)
        raise TableError(f"{file} must be {kind}, with lines like {example}; {reason}.") from error
    if not isinstance(data, dict):
        raise TableError(f"{file} must hold settings by name, like {example}; instead received {quoted(data)}.")
    return data


def finite_number(value: object) -> float | None:
    """Return a number of a settings file as a float; None for anything else, and for what a float does not hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value) if math.isfinite(value) else None
    except OverflowError:
        return None
