"""What a fit says of its data and of its own limits, one plain sentence each."""

from femfit.fit.coenergy import CoenergyFit
from femfit.fit.misfit import misfit_to_rows
from femfit.fit.rows import FitRows
from femfit.tables.sweep_table import SweepTable

_COARSE = 0.01
"""Misfit of the co-energy to its own sweep that the user is warned of."""

_UNITS_ASSUMED = "assumed-units"


def import_notes(table: SweepTable) -> tuple[str, ...]:
    """What an import warned of, and units that it assumed: a fit is wrong by the factor that they are.

    Parameters
    ----------
    table : SweepTable
        Any; a sweep's own has none.
    """
    findings = [one for one in table.manifest.get("findings") or () if isinstance(one, dict)]
    grave = [one for one in findings if one.get("severity") == "warning" or one.get("code") == _UNITS_ASSUMED]
    return tuple(f"{one.get('text', one.get('sentence', ''))} {one.get('remedy', '')}".strip() for one in grave)


def coarse_note(coenergy: CoenergyFit | None, rows: FitRows) -> tuple[str, ...]:
    """A warning where the co-energy misses the sweep that it was fitted to."""
    misfit = None if coenergy is None else misfit_to_rows(coenergy.magnetics, rows)
    if misfit is None or misfit.force_rms_relative < _COARSE:
        return ()
    note = (
        f"The co-energy misses the sweep's force by {100.0 * misfit.force_rms_relative:.2g} % rms, which a diagnosis "
        f"would inherit. The force turns faster than {len(rows.currents)} currents and {len(rows.distances)} distances "
        "tell; sweep more of both, above all where it saturates and at the smallest distances."
    )
    return (note,)
