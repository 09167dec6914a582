"""Campaigns to files, files to diagnoses as ``femfit diagnose`` makes them, diagnoses to a table of counts."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.atomic import write_json
from femfit.core.errors import FemfitError
from femfit.identify.decision.diagnose import diagnose
from femfit.tables.measurement_file import read_measurement
from femfit.trial.counts import Share
from support.device_trial.bench import bench_campaign
from support.device_trial.causes import BENCH, CLEAN, RECORDS, Cause
from support.device_trial.records import record_campaign
from support.device_trial.tables import SolvedDevice

SHOWN = 1.0
"""Rms over the noise from which a cause on a bench counts as one that could be seen."""


@dataclass(frozen=True)
class Outcome:
    """One campaign and what was said of it."""

    device: str
    kind: str
    hidden: str
    right: tuple[str, ...]
    over_noise: float
    verdict: str
    classes: tuple[tuple[str, ...], ...]
    confident: bool

    @property
    def in_class(self) -> bool:
        """Whether some class holds a right name."""
        return any(set(self.right) & set(members) for members in self.classes)

    @property
    def certain_and_wrong(self) -> bool:
        """Whether a name was called certain that is not a right one."""
        return self.confident and bool(self.classes) and not self.in_class

    @property
    def visible(self) -> bool:
        """Whether the cause could be seen; of records that is not known beforehand."""
        return not self.over_noise < SHOWN


def run_device_trial(
    devices: dict[str, SolvedDevice],
    directory: Path,
    *,
    seed: int,
    benches: int,
    records: int,
    clean: int,
    progress: Callable[[int, int], None],
) -> list[Outcome]:
    """Measure and diagnose so many campaigns a cause, and so many with nothing hidden a device and kind."""
    orders: list[tuple[str, str, Cause | None]] = []
    for causes, each in ((BENCH, benches), (RECORDS, records)):
        orders += [(one.device, one.kind, one) for one in causes for _ in range(each)]
    orders += [(name, "bench", None) for name in devices for _ in range(clean)]
    orders += [(name, "record", None) for name in devices for _ in range(records)]
    found = []
    for number, order in enumerate(orders):
        progress(number, len(orders))
        found.append(_outcome(devices, directory / f"{number:04d}", order, np.random.default_rng([seed, number])))
    return found


def _outcome(
    devices: dict[str, SolvedDevice],
    place: Path,
    order: tuple[str, str, Cause | None],
    rng: np.random.Generator,
) -> Outcome:
    name, kind, cause = order
    place.mkdir(parents=True, exist_ok=True)
    if not (place / "outcome.json").exists():
        make = bench_campaign if kind == "bench" else record_campaign
        campaign = make(devices[name], cause, rng)
        campaign.rows.to_csv(place / "data.csv", index=False, float_format="%.9g")
        said = _said(devices[name], place / "data.csv")
        write_json(place / "diagnosis.json", said)
        outcome = Outcome(
            device=name,
            kind=kind,
            hidden=CLEAN if cause is None else cause.name,
            right=() if cause is None else cause.names,
            over_noise=campaign.over_noise,
            verdict=said["verdict"],
            classes=tuple(tuple(one["class"]) for one in said["missing"]),
            confident=bool(said.get("confident")),
        )
        write_json(place / "outcome.json", asdict(outcome))
    read = json.loads((place / "outcome.json").read_text(encoding="utf-8"))
    over_noise = float("nan") if read["over_noise"] is None else read["over_noise"]
    more = {"right": tuple(read["right"]), "classes": tuple(map(tuple, read["classes"])), "over_noise": over_noise}
    return Outcome(**{**read, **more})


def _said(device: SolvedDevice, data: Path) -> dict[str, Any]:
    try:
        return diagnose(device.model, read_measurement(data), bootstrap=0).to_dict()
    except FemfitError as error:
        return {"verdict": "error", "missing": [], "confident": False, "message": str(error)}


def table_lines(outcomes: Sequence[Outcome]) -> list[str]:
    """What was counted: over all, and by cause."""
    lines = []
    for kind in ("bench", "record"):
        mine = [one for one in outcomes if one.kind == kind and one.hidden != CLEAN and one.visible]
        known, foreign = [one for one in mine if one.right], [one for one in mine if not one.right]
        clean = [one for one in outcomes if one.kind == kind and one.hidden == CLEAN]
        lines += [
            _line(kind, "nothing hidden", "something named", [bool(one.classes) for one in clean]),
            _line(
                kind, "cause with a name in the catalogue", "a right name in a class", [one.in_class for one in known]
            ),
            _line(
                kind,
                "cause with a name in the catalogue",
                "wrong and called certain",
                [one.certain_and_wrong for one in known],
            ),
            _line(kind, "cause without a name", "found missing at all", [_noticed(one) for one in foreign]),
            _line(kind, "cause without a name", "a name called certain", [one.certain_and_wrong for one in foreign]),
        ]
    lines += [
        "",
        "by cause: campaigns, of which could be seen, noticed, a right name in a class, wrong and certain; first names",
    ]
    keys = dict.fromkeys((one.device, one.kind, one.hidden) for one in outcomes)
    for key in keys:
        mine = [one for one in outcomes if (one.device, one.kind, one.hidden) == key]
        seen = [one for one in mine if one.visible]
        names = dict.fromkeys(one.classes[0][0] if one.classes else one.verdict for one in mine)
        right = f"{sum(one.in_class for one in seen)}" if mine[0].right else "-"
        noticed, wrong = sum(map(_noticed, seen)), sum(one.certain_and_wrong for one in seen)
        lines.append(
            f"  {' '.join(key):<36}{len(mine):>3}{len(seen):>4}{noticed:>4}{right:>4}{wrong:>4}   {', '.join(names)}"
        )
    return lines


def _noticed(one: Outcome) -> bool:
    return one.verdict not in {"nothing_missing", "error"}


def _line(kind: str, group: str, outcome: str, hits: Sequence[bool]) -> str:
    share = Share(sum(hits), len(hits))
    low, high = share.ci95
    return f"{kind:<8}{group:<36}{outcome:<28}{share.hits:>3} of {share.of:<4}({100 * low:.0f} to {100 * high:.0f} %)"
