"""``impedance.csv`` of a sweep: what an ampere does at each distance, bias and frequency, with an error in each row.

The windings' impedances are R + j omega L; the force and the Hall element's field of a small current about the bias are
complex, as real part and imaginary part. Errors are relative, of the largest of all circuits: estimates of what the
patterns of induced current leave out and of the discretisation.

What each number of a drawing changes of the inductances at frequencies, as ``impedance_slopes.npz``.

A table of measured inductances: one row a current step, at a clamped distance.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter

from femfit.core.errors import TableError
from femfit.core.files import replacing
from femfit.core.numerics import ComplexArray, FloatArray
from femfit.core.results import Finding, listing
from femfit.core.sweep_columns import current_columns, inductance_columns, resistance_column
from femfit.device.drawn_numbers import NumberFacts
from femfit.tables.columns import match_column
from femfit.tables.eddy_table import EddyTable, Transfers
from femfit.tables.files import read_arrays, write_arrays
from femfit.tables.findings import finding
from femfit.tables.measured_columns import has_columns, read_columns, read_raw_table
from femfit.tables.table_file import SUFFIXES

if TYPE_CHECKING:
    import pandas as pd


NAME = "impedance.csv"


def impedance_rows(
    table: EddyTable, currents: FloatArray, resistances_ohm: Sequence[float], series_H: Sequence[float]
) -> "pd.DataFrame":
    """Rows by distance, bias and frequency.

    Parameters
    ----------
    currents : array, shape (points, circuits)
        Bias currents in A; of a saturating actuator the table's own are taken.
    resistances_ohm, series_H : sequence of float
        Of each circuit: its resistance, and what is in series with it outside of the field.
    """
    import pandas as pd  # noqa: PLC0415  loads while the workers solve

    frames = []
    errors = table.error_at(table.frequencies_Hz)
    for k, distance in enumerate(table.distances_m):
        transfers = table.transfers(k, table.frequencies_Hz)
        fixed = dict(_impedances(transfers, table.circuits, resistances_ohm, series_H))
        for bias in currents if table.bias_A is None else table.bias_A[k, None]:
            columns = {
                "distance_m": np.full(len(transfers.frequencies_Hz), distance),
                **dict(zip(current_columns(table.circuits), bias, strict=True)),
                "frequency_Hz": transfers.frequencies_Hz,
                **fixed,
                **_transfers(transfers, table.circuits, bias if table.bias_A is None else np.zeros_like(bias)),
                "impedance_error": errors[:, 0],
                "force_error": errors[:, 1],
            }
            if transfers.hall is not None:
                columns["hall_error"] = errors[:, 2]
            frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def _impedances(
    transfers: Transfers, circuits: Sequence[str], resistances_ohm: Sequence[float], series_H: Sequence[float]
) -> Iterator[tuple[str, FloatArray]]:
    """Resistance and inductance of each circuit, and of each pair."""
    omega = 2.0 * np.pi * transfers.frequencies_Hz
    for name, (j, k) in inductance_columns(circuits).items():
        inductance = transfers.flux_linkage[:, j, k]
        diagonal = j == k
        yield resistance_column(name), diagonal * resistances_ohm[j] - omega * inductance.imag
        yield name, inductance.real + diagonal * series_H[j]


def _transfers(transfers: Transfers, circuits: Sequence[str], bias: FloatArray) -> Mapping[str, FloatArray]:
    """Force and Hall field of an ampere in each circuit about a bias."""
    force = np.einsum("m,fmn->fn", np.concatenate([[1.0], bias]), transfers.force)
    kinds = {"force": (force, "N_per_A"), **({} if transfers.hall is None else {"hall": (transfers.hall, "T_per_A")})}
    return {
        f"{kind}{f'_{name}' * (len(circuits) > 1)}_{component}_{unit}": getattr(values[:, k], component)
        for (kind, (values, unit)), (k, name), component in product(
            kinds.items(), enumerate(circuits), ("real", "imag")
        )
    }


def write_impedance(rows: "pd.DataFrame | None", directory: Path) -> None:
    """Write ``impedance.csv``, or remove that of an earlier sweep where there are no rows."""
    if rows is None or rows.empty:
        (directory / NAME).unlink(missing_ok=True)
        return
    with replacing(directory / NAME) as partial:
        rows.to_csv(partial, index=False)


SLOPES_NAME = "impedance_slopes.npz"


@dataclass(frozen=True, eq=False)
class ImpedanceSlopes:
    """Slopes of L(s) in Z = R + s L at some distances of a sweep, in their order.

    Parameters
    ----------
    distances_m : array, shape (d,)
    frequencies_Hz : array, shape (f,)
    slopes : array, shape (numbers, d, f, n, n)
        In H per unit of the number, or per one whole of a number without a unit.
    """

    numbers: tuple[NumberFacts, ...]
    distances_m: FloatArray
    frequencies_Hz: FloatArray
    slopes: ComplexArray


def write_slopes(slopes: ImpedanceSlopes | None, directory: Path) -> None:
    """Write the file, or remove that of an earlier sweep where there are none."""
    numbers = None if slopes is None else json.dumps([asdict(number) for number in slopes.numbers])
    write_arrays(None if slopes is None else vars(slopes) | {"numbers": numbers}, directory / SLOPES_NAME)


def read_slopes(directory: Path) -> ImpedanceSlopes | None:
    """Read what :func:`write_slopes` wrote; None where there is nothing.

    Raises
    ------
    TableError
        If the file is damaged.
    """
    return read_arrays(directory / SLOPES_NAME, _of_arrays, "Sweep again with --signatures.")


def _of_arrays(arrays: dict[str, Any]) -> ImpedanceSlopes:
    numbers = TypeAdapter(tuple[NumberFacts, ...]).validate_json(str(arrays["numbers"]))
    return ImpedanceSlopes(**arrays | {"numbers": numbers})


COLUMNS = ("distance_m", "current_A", "inductance_H")
"""Of the table; ``inductance_H`` is flux linkage over current, as a step from zero to ``current_A`` shows it."""

_OTHER_KIND = ("force_N", "flux_linkage_Wb")


@dataclass(frozen=True, eq=False)
class InductanceTable:
    """Measured inductances, each array of shape (n,), in SI."""

    distance: FloatArray
    current: FloatArray
    inductance: FloatArray
    findings: tuple[Finding, ...] = ()
    source: str = "inductances"


def is_inductance_table(path: Path) -> bool:
    """Tell whether a file holds inductances and no forces; False for a directory, and where there is no such file."""
    if not path.is_file() or path.suffix not in SUFFIXES:
        return False
    try:
        headers = read_raw_table(path, wanted=has_columns([frozenset(COLUMNS)])).headers
    except TableError:
        return False
    names = {column.name for header in headers if (column := match_column(header, (*COLUMNS, *_OTHER_KIND)))}
    return "inductance_H" in names and not names & set(_OTHER_KIND)


def read_inductance_table(
    path: Path, *, columns: Mapping[str, str] | None = None, units: Mapping[str, str | float] | None = None
) -> InductanceTable:
    """Read measured inductances; columns as in :data:`COLUMNS` or in other units (``distance_mm, inductance_mH``)."""
    raw = read_raw_table(path, wanted=has_columns([frozenset(COLUMNS)], columns, units))
    rows, _, findings = read_columns(raw, COLUMNS, columns, units)
    missing = [name for name in COLUMNS if name not in rows]
    if missing:
        raise TableError(
            f"An inductance table must have {', '.join(COLUMNS)}; {path} lacks {', '.join(missing)} (it has "
            f"{listing(raw.headers)}). Rename the columns or add them."
        )
    d, i, inductance = (rows[name].to_numpy() for name in COLUMNS)
    usable = np.isfinite(d + i + inductance) & (d >= 0.0) & (i != 0.0) & (inductance > 0.0)
    if not usable.any():
        raise TableError(f"{path} has no row with distance >= 0, a current and an inductance > 0.")
    if not usable.all():
        lost, lacking = int((~usable).sum()), "distance >= 0, current and inductance > 0"
        findings.append(finding("cells without", size=float(lost), rows=lost, columns=lacking))
    return InductanceTable(d[usable], i[usable], inductance[usable], tuple(findings), path.name)
