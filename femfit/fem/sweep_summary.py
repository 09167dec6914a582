"""What a sweep came to, in a few numbers."""

from typing import Any

from femfit.core.sweep_table import SweepTable


def summarise(table: SweepTable) -> dict[str, Any]:
    """Rows, failures, range of the force and of its estimated error.

    Parameters
    ----------
    table : SweepTable
        From a sweep.

    Returns
    -------
    dict
        JSON-ready; the relative error is over the rows whose force is not zero. Forces are None if every row failed.
    """
    status = table.rows["status"]
    good = table.valid_rows()
    failures = {str(reason): int(count) for reason, count in status[status != "ok"].value_counts().items()}
    pulling = good[good["force_N"] != 0.0]
    relative = (pulling["force_error_N"] / pulling["force_N"].abs()).max() if len(pulling) else 0.0
    return {
        "rows": len(table.rows),
        "failed": len(table.rows) - len(good),
        "failures": failures,
        "force_min_N": float(good["force_N"].min()) if len(good) else None,
        "force_max_N": float(good["force_N"].max()) if len(good) else None,
        "force_error_relative_max": float(relative),
    }
