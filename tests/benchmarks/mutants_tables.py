"""Damaged tables and FEMM models, read in process: what is refused, what is read, and what should not happen.

``python tests/benchmarks/mutants_tables.py --count 1000 --seed 1`` damages the tables and models that the tests keep,
and one table written in every kind of file, and reads each mutant by one of the readers in turn. It prints how many of
each kind were refused and read, and every mutant that raised another exception than femfit's own, took longer than
``LONGEST_S``, or gave a number that is neither finite nor missing. ``--show 20`` prints so many mutants of each kind
beside what was made of them. ``--mutant KIND NUMBER`` reads one of them alone, whose exception then ends the script.
"""

import argparse
import re
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import FemfitError
from femfit.tables.coil_record import open_coil_record
from femfit.tables.femm.read import import_fem_file
from femfit.tables.foreign import import_table
from femfit.tables.measurement_file import read_measurement
from femfit.tables.sweep_table import read_sweep_table

TESTS = Path(__file__).parents[1]
LONGEST_S = 20.0
"""For so long a mutant may be read before it counts as a hang."""

IN_A_CHILD = 500
"""MAT and HDF5 files are decoded in a process of their own, half a second each: there are so many times fewer."""

WORDS = [
    b"",
    b"nan",
    b"1e308",
    b"-1",
    b"0",
    b"1e-320",
    b"9.9E37",
    b"1,5",
    b"1.234",
    b"x",
    b"12:00:01",
    b"\xff",
    b";",
    b"\t",
]
NUMBER = re.compile(rb"-?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?")
ACCEPTED = ("cells", "contradictions", "one-current", "one-distance", "suspected-unit", "reciprocity", "distance")

Mutate = Callable[[np.random.Generator, bytes], bytes]


@dataclass(frozen=True)
class Kind:
    """Files that are damaged and read alike."""

    seeds: list[Path]
    readers: list[Callable[[Path], Any]]
    mutate: Mutate
    fewer: int = 1


def mutated_text(rng: np.random.Generator, content: bytes) -> bytes:
    """A text with a few numbers, bytes, lines or cells changed, repeated, swapped or lost."""
    for _ in range(rng.integers(1, 5)):
        lines = content.split(b"\n")
        k, other = rng.integers(0, len(lines), 2)
        cells = re.split(rb"([,;\t ]+)", lines[k])
        match int(rng.integers(0, 8)):
            case 0:
                places = [match.span() for match in NUMBER.finditer(content)] or [(0, 0)]
                first, last = places[rng.integers(0, len(places))]
                content = content[:first] + WORDS[rng.integers(0, len(WORDS))] + content[last:]
            case 1:
                place = rng.integers(0, len(content) + 1)
                content = content[:place] + bytes([rng.integers(0, 256)]) + content[place + rng.integers(0, 2) :]
            case 2:
                first, last = sorted(rng.integers(0, len(content) + 1, 2))
                content = content[:first] + content[min(last, first + 200) :]
            case 3:
                content = b"\n".join([*lines[:k], lines[other], *lines[k:]])
            case 4:
                content = b"\n".join([*lines[:k], *lines[k + 1 :]])
            case 5:
                cells[rng.integers(0, len(cells))] = WORDS[rng.integers(0, len(WORDS))]
                content = b"\n".join([*lines[:k], b"".join(cells), *lines[k + 1 :]])
            case 6:
                content = content.replace(*((b",", b";"), (b".", b","), (b"\n", b"\r\n"))[rng.integers(0, 3)])
            case _:
                header = re.split(rb"([,;\t ]+)", lines[0])
                header[rng.integers(0, len(header))] = header[rng.integers(0, len(header))]
                content = b"\n".join([b"".join(header), *lines[1:]])
    return content


def mutated_bytes(rng: np.random.Generator, content: bytes) -> bytes:
    """A binary file with a few bytes changed, a piece lost, or a piece of it elsewhere."""
    damaged = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        place, length = int(rng.integers(0, len(damaged) + 1)), int(rng.integers(1, 64))
        match int(rng.integers(0, 4)):
            case 0:
                damaged[place : place + 1] = bytes([rng.integers(0, 256)])
            case 1:
                damaged[place : place + 4] = rng.bytes(4)
            case 2:
                damaged = damaged[:place] + damaged[place + length :]
            case _:
                begin = int(rng.integers(0, len(damaged) + 1))
                damaged[place : place + length] = damaged[begin : begin + length]
    return bytes(damaged)


def example() -> pd.DataFrame:
    """A record of a body that swings before a coil."""
    moment = np.arange(400) / 1000.0
    swing = np.sin(20.0 * moment) + 1e-3 * np.random.default_rng(1).standard_normal((4, 400))
    columns = {"current_A": 0.5 + 0.1 * swing[0], "distance_m": 0.02 + 1e-3 * swing[1], "hall_T": 0.1 * swing[2]}
    return pd.DataFrame({"time_s": moment, **columns, "coil_voltage_V": 0.3 * swing[3]})


def containers(folder: Path) -> dict[str, Path]:
    """The example in each kind of file that is no text."""
    import h5py
    from nptdms import ChannelObject, TdmsWriter
    from scipy.io import savemat, wavfile

    rows = example()
    files = {suffix: folder / f"seed.{suffix}" for suffix in ("parquet", "xlsx", "mat", "h5", "tdms", "wav", "f32")}
    rows.to_parquet(files["parquet"])
    rows[:50].to_excel(files["xlsx"], index=False)
    savemat(files["mat"], {"log": {name: rows[name].to_numpy() for name in rows}})
    with h5py.File(files["h5"], "w") as file:
        for name in rows:
            file[f"log/{name}"] = rows[name].to_numpy()
    with TdmsWriter(files["tdms"]) as writer:
        writer.write_segment([ChannelObject("log", name, rows[name].to_numpy()) for name in rows])
    wavfile.write(files["wav"], 1000, np.int16(3e4 * np.tanh(rows[["current_A", "coil_voltage_V"]].to_numpy())))
    rows[["coil_voltage_V", "hall_T"]].to_numpy("<f4").tofile(files["f32"])
    files["f32"].with_suffix(".toml").write_text('sample_rate_Hz = 1000\ncolumns = ["coil_voltage_V", "hall_T"]\n')
    return files


def coil_record(path: Path, **options: Any) -> pd.DataFrame:
    """The samples of a coil record."""
    blocks = list(open_coil_record(path, **options).blocks())
    return pd.DataFrame({"time": np.concatenate([block.time for block in blocks])})


def kinds(folder: Path) -> dict[str, Kind]:
    """What is damaged, by its name."""
    inputs = TESTS / "golden" / "inputs"
    roots = (TESTS / "tables" / "files", inputs / "tables", inputs / "benches", inputs / "records")
    texts = [path for root in roots for path in sorted(root.rglob("*")) if path.suffix in {".csv", ".txt"}]
    models = [*sorted((TESTS / "tables" / "fem").glob("*.fem")), *sorted((inputs / "fem").glob("*.fem"))]
    accepting = partial(import_table, accept=ACCEPTED)
    every = [read_measurement, import_table, accepting, coil_record]
    wav = partial(coil_record, columns={"channel 1": "coil_voltage_V"})
    readers = {"wav": [read_measurement, wav], "f32": [coil_record]}
    return {
        "text": Kind([path for path in texts if path.stat().st_size < 2e4], [*every, read_sweep_table], mutated_text),
        "fem": Kind(models, [import_fem_file], mutated_text),
        **{
            suffix: Kind(
                [path], readers.get(suffix, every), mutated_bytes, IN_A_CHILD if suffix in {"mat", "h5"} else 1
            )
            for suffix, path in containers(folder).items()
        },
    }


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """End with a TimeoutError what takes longer."""

    def late(*_: object) -> None:
        raise TimeoutError(f"more than {seconds:g} s")

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def outcome(read: Callable[[Path], Any], path: Path) -> tuple[str, str]:
    """What a reader made of a file: ``refused`` or ``read`` with its words, or what should not happen."""
    try:
        with at_most(LONGEST_S):
            result = read(path)
            text = str(result)
    except FemfitError as error:
        return "refused", str(error)
    rows = getattr(result, "rows", result)
    if isinstance(rows, pd.DataFrame):
        infinite = np.isinf(rows.select_dtypes("number").to_numpy(dtype=np.float64))
        return ("infinite" if infinite.any() else "read"), text
    return "read", text


def mutant(kind: Kind, seed: int, number: int, folder: Path) -> Path:
    """A damaged file in the folder, under the name of what it was."""
    rng = np.random.default_rng([seed, number])
    origin = kind.seeds[rng.integers(0, len(kind.seeds))]
    path = folder / origin.name
    path.write_bytes(kind.mutate(rng, origin.read_bytes()))
    return path


def changes(path: Path, kind: Kind) -> str:
    """The lines of a text that were changed."""
    (origin,) = [seed for seed in kind.seeds if seed.name == path.name][:1]
    before, after = (set(place.read_bytes().split(b"\n")) for place in (origin, path))
    gone, new = (b" | ".join(sorted(lines)[:4])[:300] for lines in (before - after, after - before))
    return f"- {gone!r}\n  + {new!r}"


def main() -> int:
    """Read the mutants."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000, help="mutants of all kinds together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", help="those alone")
    parser.add_argument("--show", type=int, default=0, help="mutants of each kind that are printed with their outcome")
    parser.add_argument("--mutant", nargs=2, metavar=("KIND", "NUMBER"), help="one alone")
    options = parser.parse_args()
    warnings.simplefilter("error")
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        folder, place = Path(name), Path(name) / "mutants"
        place.mkdir()
        (place / "seed.toml").write_text('sample_rate_Hz = 1000\ncolumns = ["coil_voltage_V", "hall_T"]\n')
        chosen = kinds(folder)
        if options.mutant:
            kind = chosen[options.mutant[0]]
            path = mutant(kind, options.seed, int(options.mutant[1]), place)
            read = kind.readers[int(options.mutant[1]) % len(kind.readers)]
            print(changes(path, kind), *outcome(read, path), sep="\n")
            return 0
        chosen = {name: kind for name, kind in chosen.items() if name in (options.kinds or chosen)}
        for title, kind in chosen.items():
            counts, begin = Counter[str](), time.perf_counter()
            for number in range(max(1, options.count // len(chosen) // kind.fewer)):
                path, read = mutant(kind, options.seed, number, place), kind.readers[number % len(kind.readers)]
                try:
                    result, words = outcome(read, path)
                except Exception as error:  # noqa: BLE001  it is what this looks for
                    result, words = type(error).__name__, str(error)
                counts[result] += 1
                head = f"{title} {number} of {path.name}: {result}: {words[:600]}"
                if result not in {"read", "refused"}:
                    wrong += 1
                    print(head)
                elif number < options.show:
                    print(f"{head}\n  {changes(path, kind)}")
                path.unlink()
            print(f"{title}: {dict(counts)} in {time.perf_counter() - begin:.0f} s", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
