"""A trial's files: what the engine may read, and the keys that it may not.

::

    cases/0001/model.json, data.csv, data.toml (some), unseen.csv
    keys/0001.json            effects and sizes, with a random salt
    manifest.json             SHA-256 of every key: a commitment that nobody changed them after the diagnosis
"""

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.atomic import write_json
from femfit.core.errors import RunDirectoryError
from support.trial_study.campaign.case import Case


def write_case(case: Case, model: Path, directory: Path) -> str:
    """Write a case and its key."""
    name = f"{case.order.number:04d}"
    place = directory / "cases" / name
    place.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(model, place / "model.json")
    case.rows.to_csv(place / "data.csv", index=False, float_format="%.9g")
    case.unseen.to_csv(place / "unseen.csv", index=False, float_format="%.9g")
    if case.declared_noise:
        lines = "".join(f"{channel} = {value:g}\n" for channel, value in case.declared_noise.items())
        (place / "data.toml").write_text(f"[noise]\n{lines}", encoding="utf-8")
    salt = np.random.default_rng([case.order.seed, case.order.number, 1]).bytes(16).hex()
    text = json.dumps({**case.key, "salt": salt}, indent=1)
    keys = directory / "keys"
    keys.mkdir(exist_ok=True)
    (keys / f"{name}.json").write_text(text, encoding="utf-8")
    return hashlib.sha256(text.encode()).hexdigest()


def read_key(directory: Path, number: int, commitment: str) -> dict[str, Any]:
    """Open a case's key, after the diagnosis."""
    path = directory / "keys" / f"{number:04d}.json"
    text = path.read_text(encoding="utf-8")
    if hashlib.sha256(text.encode()).hexdigest() != commitment:
        raise RunDirectoryError(
            f"{path} must be as it was when the trial began; it was changed. Run the trial again in another directory."
        )
    return dict(json.loads(text))


def write_manifest(directory: Path, seed: int, commitments: Mapping[int, str]) -> Path:
    """Write the manifest."""
    path = directory / "manifest.json"
    data = {"seed": seed, "cases": len(commitments), "key_sha256": {f"{n:04d}": h for n, h in commitments.items()}}
    write_json(path, data)
    return path
