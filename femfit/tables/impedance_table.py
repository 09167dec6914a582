"""``impedance.csv`` of a sweep: what an ampere does at each distance, bias and frequency, with an error in each row.

The windings' impedances are R + j omega L; the force and the Hall element's field of a small current about the bias are
complex, as real part and imaginary part. Errors are relative, of the largest of all circuits: estimates of what the
patterns of induced current leave out and of the discretisation.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.files import replacing
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import current_columns, inductance_columns, resistance_column
from femfit.tables.eddy_table import EddyTable, Transfers

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
