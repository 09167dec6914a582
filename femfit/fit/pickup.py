"""The flux linkages of a sweep's pickup coils, fitted one by one."""

from femfit.core.errors import FitError
from femfit.core.sweep_columns import PICKUP_COLUMN
from femfit.fit.sensed_field import SensedFit, SensedRows, fit_sensed
from femfit.tables.sweep_table import SweepTable, current_names


def fit_pickups(table: SweepTable) -> dict[str, SensedFit | str]:
    """The flux linkage of each pickup coil of a table by the coil's name, or why it could not be fitted."""
    rows, fits = table.valid_rows(), dict[str, SensedFit | str]()
    currents = rows[current_names(rows)].to_numpy(dtype=float)
    if not currents.any():  # a pair of magnets, or one current of zero: nothing to fit along
        currents = currents[:, :0]
    distance = rows["distance_m"].to_numpy(dtype=float)
    for column in map(str, rows.columns):
        match = PICKUP_COLUMN.fullmatch(column)
        if match is None:
            continue
        values = rows[column].to_numpy(dtype=float)
        try:
            fits[match[1]] = fit_sensed(SensedRows(distance, currents, values), f"Pickup coil {match[1]!r}")
        except FitError as error:
            fits[match[1]] = str(error)
    return fits
