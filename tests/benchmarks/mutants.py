"""Damaged files of every kind that femfit reads: ``python tests/benchmarks/mutants.py --count 20000 --seed 1``.

Each is read in this process: accepted, or refused by an error of femfit. Printed are, of each target, how many of
either and the slowest, and each mutant of which something else came: another exception, more than ``SECONDS``, what
means nothing although it was accepted. ``--targets NAME --seed NUMBER --count 1`` makes that mutant again.
``--show 20 FILE`` writes so many acceptances and refusals of each target with their changes, to be read by eye.
"""

import argparse
import faulthandler
import json
import re
import shutil
import signal
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pandas as pd
from shapely import Polygon

import femfit as ff
from femfit.core.errors import FemfitError
from femfit.core.journal import Journal, JournalHeader
from femfit.core.results import json_ready
from femfit.device.load import actuator_from_record
from femfit.device.outlines import flattened
from femfit.device.rewrite import variants_from_toml
from femfit.integrate.bench_table import make_bench_table
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.tables.coil_record import open_coil_record
from femfit.tables.femm.read import import_fem_file
from femfit.tables.measurement_file import read_inductance_table
from femfit.tables.sweep_table import write_sweep_table

ROOT = Path(__file__).parents[2]
INPUTS, FILES = ROOT / "tests/golden/inputs", ROOT / "tests/tables"
FOLDERS = ("geometry", "femfit/device/examples", "docs/reference", "tests/device/drawings", "tests/support/drawings")
DRAWINGS = [path for folder in FOLDERS for path in sorted((ROOT / folder).glob("*.toml"))]
SECONDS = 20
ACCEPTED = ("cells", "contradictions", "one-current", "one-distance", "suspected-unit", "reciprocity")
WORDS = (
    *("nan", "inf", "-inf", "0", "-1", "2.5", "1e308", "-1e308", "1e-320", "9.9E37", "1,5", "1.234", "1" * 400, "true"),
    *("", "x", '"text"', "'+z'", '""', ";", "\t", "12:00:01", "1979-05-27", "'\\u001b[31m'", "[]", "{}", "[[]]"),
    *("[1, 'x']", "[0, 5.5]", "[[0, 0]]", "[[0, 0], [1, 0], [0, 1]]", "[1, 2, 3]", "{ a = 1 }", '"force_N"', '"mm"'),
    *("{ start = 0, stop = 2, step = 1 }", "{ start = 0, stop = 1e300, step = 1e-300 }", "\xff"),
)  # fmt: skip
VALUES = (np.nan, np.inf, 0, -1, 1e308, 1e-308, 2**70, 0.5, 1e6, "", "x", None, True, [], {}, [1.0, 2.0], [[1.0]])
MARKS = (b",", b";"), (b".", b","), (b" ", b"\t"), (b"\n", b"\r\n")
FACTORS = (-1.0, 0.0, 1e-3, 0.1, 0.9, 1.1, 10.0, 1e3, 1e12)
BETWEEN, DATA = re.compile(rb"([,;\t\[\]{} =]+)"), re.compile(rb"\s*[-+.]?\d")
NOT_MEANT = re.compile(r"Traceback|object at 0x|\x1b|Undefined")


def pick(items: Any, random: np.random.Generator) -> Any:
    return items[random.integers(len(items))]


def telling(lines: list[bytes]) -> list[int]:
    return [k for k, line in enumerate(lines) if line.strip() and not line.startswith(b"#")] or [0]


def changed_line(content: bytes, other: bytes, random: np.random.Generator) -> bytes:
    """A line lost, repeated, of another file, with another value or with other marks; or other marks throughout."""
    lines, marks, word = content.split(b"\n"), pick(MARKS, random), pick(WORDS, random).encode("latin-1")
    k = pick(telling(lines), random)
    line, foreign = lines[k], pick(other.split(b"\n"), random)
    others = [], [line, line], [foreign, line], [line.partition(b" = ")[0] + b" = " + word], [line.replace(*marks)]
    again = b"\n".join([*lines[:k], *others[random.integers(5)], *lines[k + 1 :]])
    return again if random.integers(6) else content.replace(*marks)


def changed_cell(content: bytes, _other: bytes, random: np.random.Generator) -> bytes:
    """A cell, key or number, often of the first lines, replaced, scaled or misspelt."""
    lines = content.split(b"\n")
    k = pick(telling(lines)[: pick((4, None, None), random)], random)
    cells = BETWEEN.split(lines[k])
    c = 2 * random.integers(len(cells) // 2 + 1)
    cell, at = cells[c], random.integers(len(cells[c]) + 1)
    number = re.fullmatch(rb"-?\d+(\.\d+)?", cell)
    scaled = [str(pick(FACTORS, random) * float(cell)).encode()] * 2 if number else []
    mangled = cell[:at] + cell[at + 1 :], cell[:at] + b"x" + cell[at:], cell.upper()
    words = [pick(WORDS, random).encode("latin-1") for _ in range(2)]
    cells[c] = pick([*words, pick(mangled, random), *scaled], random)
    lines[k] = b"".join(cells)
    return b"\n".join(lines)


def changed_bytes(content: bytes, _other: bytes, random: np.random.Generator) -> bytes:
    """A few bytes changed, a piece lost, or a piece of it elsewhere."""
    at, begin, length = *random.integers(len(content) + 1, size=2), random.integers(1, 200)
    others = random.bytes(1), random.bytes(4), b"", content[begin : begin + length]
    lost = random.integers(2), 4, length, length
    return pick(
        [content[:at]] + [content[:at] + o + content[at + n :] for o, n in zip(others, lost, strict=True)], random
    )


def changed_entry(content: bytes, other: bytes, random: np.random.Generator) -> bytes:
    """One place of a JSON document altered or left out."""
    document = [json.loads(content)]
    holder, last = pick(list(places(document)), random)
    kept, values = holder[last], [pick(VALUES, random), pick(VALUES, random)]
    scaled = [kept * pick(FACTORS, random)] if isinstance(kept, float) else []
    holder[last] = pick([*values, *scaled, KeyError], random)
    if holder[last] is KeyError:
        del holder[last]
    return json.dumps(*document or [None], indent=1).encode()


def places(holder: Any) -> Iterator[tuple[Any, Any]]:
    for key in list(holder) if isinstance(holder, dict) else range(len(holder)):
        yield holder, key
        if isinstance(holder[key], dict | list):
            yield from places(holder[key])


TEXT = (changed_cell, changed_cell, changed_cell, changed_line, changed_line, changed_bytes)
CHANGES = {
    ".json": (changed_entry,),
    **dict.fromkeys((".csv", ".txt", ".toml", ".fem", ".jsonl", ".xml", ".rels"), TEXT),
}
"""What is done to a file, by its suffix; to all others, bytes are changed."""

ZIPPED = {".xlsx", ".npz"}
"""Of which a file inside is changed: a changed byte of their own is found by its sum."""


def damaged_file(content: bytes, suffix: str, other: bytes, random: np.random.Generator) -> bytes:
    """A file with one to three changes, mostly one."""
    if suffix in ZIPPED:
        with ZipFile(BytesIO(content)) as archive, ZipFile(written := BytesIO(), "w") as copy:
            chosen = pick(archive.namelist(), random)
            for name in archive.namelist():
                member = archive.read(name)
                copy.writestr(name, damaged_file(member, Path(name).suffix, b"1", random) if name == chosen else member)
        return written.getvalue()
    changes = CHANGES.get(suffix, (changed_bytes,))
    for _ in range(pick((1, 1, 2, 3), random)):
        content = pick(changes, random)(content, other, random)
    return content


# What is accepted must mean something: each of these uses a file, and asserts what must then be true


def use_actuator(actuator: ff.Actuator) -> None:
    """Finite positive sizes, and the same actuator from its record."""
    bodies = [*actuator.regions, *actuator.coils]
    outlines = [(body.vertices_m, getattr(body, "bulges", ()) or [0.0] * len(body.vertices_m)) for body in bodies]
    areas = [Polygon(flattened(*outline)) for outline in outlines]
    assert all(area.is_valid and 0.0 < area.area < 1e4 and area.bounds[0] >= 0.0 for area in areas), "no outline"
    sizes = [actuator.mechanics.mass_kg, *(n for coil in actuator.coils for n in (coil.turns, coil.resistance_ohm))]
    assert all(0.0 < size < 1e12 for size in sizes), f"sizes {sizes}"
    sweep = actuator.sweep
    assert list(sweep.distances_m) == sorted({*sweep.distances_m}), "distances that do not ascend"
    assert np.isfinite([*sweep.distances_m, *sweep.currents_A]).all(), "an axis that is not finite"
    assert str(actuator)
    record = json.loads(json.dumps(json_ready(asdict(actuator)), allow_nan=False))
    assert actuator_from_record(record, "record") == actuator, "another actuator from its record"


def use_drawing(path: Path) -> None:
    path = path.with_name("every-key.toml") if path.suffix == ".csv" else path  # whose curve it is
    use_actuator(ff.read_actuator(path))
    text = path.read_text(encoding="utf-8-sig")
    if "parameters" in tomllib.loads(text)["sweep"]:
        variants_from_toml(text, "mutant", path.parent)


def use_model(model: ff.ActuatorModel) -> None:
    """Finite forces, and the same model from its file."""
    assert np.isfinite(model.magnetics.force(*model.validity.grid(3, 3, several=2))).all(), "forces that are not finite"
    again = json.loads(json.dumps(model_to_dict(model), allow_nan=False))
    assert json.dumps(model_to_dict(model_from_dict(again, "again"))) == json.dumps(again), "another model when written"


def use_sweep(path: Path) -> pd.DataFrame:
    table = ff.read_sweep(path.parent if path.stem in {"manifest", "signatures", "eddy"} else path)
    assert all(map(str, (table, table.signatures, table.eddy, table.still_mm, table.saturating)))
    needed = table.valid_rows()[["distance_m", "force_N"]].to_numpy(dtype=float)
    assert np.isfinite(needed).all(), "points without numbers"
    return table.rows


def use_measured(path: Path) -> pd.DataFrame:
    measured = ff.read_measurement(path)
    assert str(measured)
    assert all(0.0 < noise < np.inf for noise in measured.declared_noise.values()), "noise that is none"
    return measured.rows[[name for name in measured.given if name not in {"run", "mount", "order", "branch"}]]


def use_import(path: Path, **options: Any) -> pd.DataFrame | None:
    table = ff.import_table(path.parent if path.parent.name == "by-current" else path, **options)
    assert str(table)
    rows = table.valid_rows().drop(columns=["status", "force_error_N"], errors="ignore")
    assert np.isfinite(rows.to_numpy(dtype=float)).all(), "points without numbers"
    return None if options else rows  # points that contradict each other may be averaged


def use_coil(path: Path, **options: Any) -> pd.DataFrame:
    blocks = list(open_coil_record(path, **options).blocks())
    names = [name for name, column in vars(blocks[0]).items() if column is not None]
    return pd.DataFrame({name: np.concatenate([getattr(block, name) for block in blocks]) for name in names})


def use_integral(path: Path, **options: Any) -> None:
    integral = ff.integrate_coil(path, **options)
    assert str(integral)
    assert np.isfinite([integral.value, integral.standard_uncertainty]).all(), "an integral that is not finite"
    rows = integral.rows[integral.rows[integral.quantity].first_valid_index() :]  # before, its reference read nothing
    assert not rows.filter(regex="field|flux|offset").isna().to_numpy().any(), "nan in an integral"


def use_bench_flux(path: Path) -> None:
    made = make_bench_table(path)
    assert str(made)
    assert np.isfinite(made.rows["flux_linkage_Wb"]).all(), "nan in a bench table's flux linkage"


def use_inductance(path: Path) -> pd.DataFrame:
    table = vars(read_inductance_table(path))
    return pd.DataFrame({name: table[name] for name in ("distance", "current", "inductance")})


def use_fem(path: Path) -> None:
    imported = import_fem_file(path)
    assert str(imported)
    json.dumps(imported.to_dict(), allow_nan=False)
    use_actuator(imported.actuator)


HEADER = JournalHeader("c0ffee", {"drawing": "1", "settings": "2"})
FINISHED = {f"{k} mm": {"force_N": [0.1 * k, 1.0 / (k + 1)], "status": "ok"} for k in range(30)}


def use_journal(path: Path) -> None:
    for aside in path.parent.glob("journal-*"):  # of a mutant before
        aside.unlink()
    with Journal(path.parent, HEADER) as journal:
        assert all(FINISHED.get(key) == result for key, result in journal.finished.items()), "a result that was none"


@dataclass(frozen=True)
class Target:
    """Files of one kind, and what uses them."""

    seeds: list[Path]
    uses: list[Callable[[Path], Any]]
    share: float = 1.0  # Of the mutants, beside the others'


def make_files(folder: Path) -> None:
    """A record and a bench in each kind of file that is no text, raw records, a sweep, and a journal."""
    import h5py
    from nptdms import ChannelObject, TdmsWriter
    from scipy.io import savemat, wavfile

    kinds = ("parquet", "xlsx", "mat", "h5", "tdms", "wav", "raw", "raw-json", "coil", "journal", "sweep")
    for kind in kinds:
        (folder / kind).mkdir()
    moment, bench = np.arange(400) / 1000.0, pd.read_csv(INPUTS / "benches/rig-no-run.csv")
    swing = np.sin(20.0 * moment) + 1e-3 * np.random.default_rng(1).standard_normal((4, 400))
    record = pd.DataFrame({"time_s": moment, "current_A": 0.5 + 0.1 * swing[0], "distance_m": 0.02 + 1e-3 * swing[1]})
    record = record.assign(hall_T=0.1 * swing[2], coil_voltage_V=0.3 * swing[3])
    write_sweep_table(ff.read_sweep(INPUTS / "sweeps/plunger"), folder / "sweep")
    with Journal(folder / "journal", HEADER) as journal:
        for key, result in FINISHED.items():
            journal.record(key, result)
    for name, rows in {"record": record, "bench": bench}.items():
        parquet, xlsx, mat, h5, tdms = (folder / kind / f"{name}.{kind}" for kind in kinds[:5])
        rows.to_parquet(parquet, compression=None)
        rows[:50].to_excel(xlsx, index=False)
        savemat(mat, {"log": {column: rows[column].to_numpy() for column in rows}})
        with h5py.File(h5, "w") as file:
            for column in rows:
                file[f"log/{column}"] = rows[column].to_numpy()
        with TdmsWriter(tdms) as writer:
            writer.write_segment([ChannelObject("log", column, rows[column].to_numpy()) for column in rows])
    samples = np.int16(3e4 * np.tanh(record[["current_A", "coil_voltage_V"]].to_numpy()))
    wavfile.write(folder / "wav/record.wav", 1000, samples)
    record.to_csv(folder / "coil/record.csv", index=False)
    for kind in ("raw", "raw-json"):
        record[["coil_voltage_V", "hall_T"]].to_numpy("<f4").tofile(folder / kind / "record.f32")
    layout = {"sample_rate_Hz": 1000, "start_s": 0.5, "columns": ["coil_voltage_mV", "hall_mT"]}
    (folder / "raw/record.toml").write_text("".join(f"{key} = {json.dumps(layout[key])}\n" for key in layout))
    (folder / "raw-json/record.json").write_text(json.dumps(layout))


def found(pattern: str, root: Path = INPUTS, largest: float = 1e5) -> list[Path]:
    paths = [path for path in sorted(root.glob(pattern)) if path.stat().st_size < largest]
    assert paths, pattern
    return paths


def targets(folder: Path) -> dict[str, Target]:
    """What is damaged, by its name; the shares make each take some hours of a night at most."""
    make_files(folder)
    tables = [*found("files/*.csv", FILES), *found("files/*.txt", FILES), *found("tables/*.*")]
    accepting = partial(use_import, accept=ACCEPTED)
    every = [use_measured, use_import, accepting, use_coil, partial(use_integral, coil_area_m2=0.06), use_bench_flux]
    raw = lambda use: lambda path: use(path.with_suffix(".f32"))  # noqa: E731  its layout stands beside it
    wav = {"columns": {"channel 1": "coil_voltage_V"}}
    return {
        "drawing": Target(DRAWINGS, [use_drawing], 10),
        "curve": Target([ROOT / "docs/reference/steel.csv"], [use_drawing]),
        "model": Target(found("models/*.json", largest=1e6), [lambda path: use_model(ff.read_model(path))]),
        "bench": Target([*found("benches/*.csv"), FILES / "files/bench.csv"], [use_measured], 4),
        "record": Target(found("records/*.csv"), [use_measured]),
        "impedance": Target([*found("benches/*impedance.csv"), FILES / "files/lcr-meter.csv"], [use_measured]),
        "sidecar": Target(found("benches/*.toml"), [lambda path: use_measured(path.with_suffix(".csv"))], 2),
        "coil": Target([*found("coil/*", folder), FILES / "files/coil.csv"], every[3:]),
        "raw": Target(found("raw*/*", folder), [raw(use_coil), raw(every[4])]),
        "foreign": Target([*tables, *found("tables/by-current/*.csv")], [use_import, accepting], 6),
        "table": Target(tables, every, 4),
        "inductance": Target([INPUTS / "tables/inductance.csv"], [use_inductance]),
        "fem": Target([*found("fem/*.fem", FILES), *found("fem/*.fem")], [use_fem], 4),
        "sweep": Target([*found("sweeps/*/*.*"), *found("sweep/*", folder)], [use_sweep], 2),
        "fit": Target(found("sweeps/*/*.*"), [lambda path: use_model(ff.fit_model(path.parent).model)], 0.01),
        "journal": Target(found("journal/*", folder), [use_journal]),
        **{name: Target(found(f"{name}/*", folder), every, 2) for name in ("parquet", "tdms")},
        "xlsx": Target(found("xlsx/*", folder), every),
        "wav": Target(found("wav/*", folder), [use_measured, partial(use_coil, **wav), partial(use_integral, **wav)]),
        **{name: Target(found(f"{name}/*", folder), every[:4], 0.02) for name in ("mat", "h5")},
    }  # fmt: skip


def check_cells(seed: tuple[bytes, pd.DataFrame], mutant: tuple[bytes, pd.DataFrame]) -> None:
    """No more numbers of a column are new than lines came or went, where the table's head is the same."""
    (before, rows), (after, others) = ((content.splitlines(), frame) for content, frame in (seed, mutant))
    head = next((k for k, line in enumerate(before) if DATA.match(line)), len(before) - 1)
    if before[:head] != after[:head]:
        return
    changed = len({*before} ^ {*after})
    for name in rows.columns.intersection(others.columns).difference(["time_s", "time"]):
        known, values = (pd.to_numeric(frame[name], errors="coerce").dropna().to_numpy() for frame in (rows, others))
        fresh = np.setdiff1d(*(np.array([f"{abs(value):.8e}" for value in column]) for column in (values, known)))
        assert len(fresh) <= changed, f"{name} has {len(fresh)} new numbers ({fresh[0]}) by {changed} changed lines"


def outcome(use: Callable[[Path], Any], path: Path, seed: tuple[bytes, Any]) -> tuple[str, str]:
    """What became of a file: ``accepted`` or ``refused``, with the words, or what should not happen."""
    try:
        rows = use(path)
        if isinstance(rows, pd.DataFrame):
            assert not np.isinf(rows.select_dtypes("number").to_numpy(dtype=float)).any(), "numbers that are infinite"
            if isinstance(seed[1], pd.DataFrame) and path.suffix in {".csv", ".txt"}:
                check_cells(seed, (path.read_bytes(), rows))
    except FemfitError as error:
        words = str(error)
        return ("long" if len(words) > 6000 else "unclear" if NOT_MEANT.search(words) else "refused"), words
    except AssertionError as error:
        return "nonsense", str(error)
    except Exception as error:  # noqa: BLE001  this is what is looked for
        place = traceback.extract_tb(error.__traceback__)[-1]
        return type(error).__name__, f"{str(error)[:200]} at {Path(place.filename).name}:{place.lineno}"
    return "accepted", "" if rows is None else "; ".join(f"{n} {rows[n].min()} to {rows[n].max()}" for n in rows)


def changes(before: bytes, after: bytes) -> str:
    lines = [content.split(b"\n") for content in (before, after)]
    gone, new = (sorted({*some}.difference(others), key=some.index)[:4] for some, others in (lines, lines[::-1]))
    return f"{len(before)} to {len(after)} bytes\n  - {str(gone)[:400]}\n  + {str(new)[:400]}"


def mutants_of(target: Target, folder: Path) -> Callable[[int], tuple[str, str, str]]:
    """What makes the mutant of a number, in a copy of its seed's folder, and says what became of it."""
    paths = [folder / str(k) / seed.name for k, seed in enumerate(target.seeds)]
    for seed, path in zip(target.seeds, paths, strict=True):
        shutil.copytree(seed.parent, path.parent, ignore=lambda top, names: [n for n in names if Path(top, n).is_dir()])
        if path.suffix == ".json":  # a line an entry, whose changes can be shown
            path.write_text(json.dumps(json.loads(path.read_text()), indent=1))
    contents = [path.read_bytes() for path in paths]

    @cache
    def unharmed(k: int, n: int) -> Any:
        with suppress(FemfitError):
            return target.uses[n](paths[k])

    def mutant(number: int) -> tuple[str, str, str]:
        random, n = np.random.default_rng(number), number % len(target.uses)
        k = int(random.integers(len(paths)))
        seed = contents[k], unharmed(k, n)
        after = damaged_file(seed[0], paths[k].suffix, pick(contents, random), random)
        paths[k].write_bytes(after)
        try:
            signal.alarm(SECONDS)
            result, words = outcome(target.uses[n], paths[k], seed)
        finally:
            signal.alarm(0)
            paths[k].write_bytes(seed[0])
        return result, words, f"{target.seeds[k].name}, use {n}: {changes(seed[0], after)}"

    return mutant


def stopped(*_: object) -> None:
    raise TimeoutError(f"more than {SECONDS} s")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000, help="mutants of all targets together")
    parser.add_argument("--seed", type=int, default=1, help="of the first mutant; each has the next one")
    parser.add_argument("--targets", nargs="*", help="those alone")
    parser.add_argument("--show", nargs=2, metavar=("NUMBER", "FILE"), default=(0, "/dev/null"))
    options = parser.parse_args()
    warnings.simplefilter("error")
    signal.signal(signal.SIGALRM, stopped)
    wrong = 0
    with tempfile.TemporaryDirectory() as name, Path(options.show[1]).open("w", encoding="utf-8") as shown:
        every = targets(Path(name))
        chosen = {title: every[title] for title in options.targets or every}
        for title, target in chosen.items():
            mutant, counts, slowest = mutants_of(target, Path(name) / f"mutants of {title}"), Counter[str](), (0.0, 0)
            count = max(1, round(options.count * target.share / sum(one.share for one in chosen.values())))
            begin = time.perf_counter()
            for number in range(options.seed, options.seed + count):
                faulthandler.dump_traceback_later(6 * SECONDS, exit=True)  # what holds the interpreter hears no alarm
                before = time.perf_counter()
                result, words, changed = mutant(number)
                slowest = max(slowest, (time.perf_counter() - before, number))
                counts[result] += 1
                text = f"{title} {number}: {result}: {words}\n  {changed}"
                if result not in {"accepted", "refused"}:
                    wrong += 1
                    print(text[:1500], flush=True)
                elif counts[result] <= int(options.show[0]):
                    print(text[:3000], file=shown)
            faulthandler.cancel_dump_traceback_later()
            took, said = time.perf_counter() - begin, ", ".join(f"{result} {n:,}" for result, n in counts.items())
            print(f"{title}: {count:,} in {took:.0f} s, slowest {slowest[0]:.2f} s ({slowest[1]}): {said}", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
