"""What a fit says of its data and of its own limits, one plain sentence each."""

from femfit.core.amount import amount
from femfit.fit.rows import FitRows
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import CoenergySpline
from femfit.tables.sweep_table import SweepTable

COARSE = 0.01
"""Misfit of the force (rms relative error) that a co-energy's user is warned of; conventional."""

POOR_CIRCUIT = 0.1
"""Misfit of flux linkage or inductance, over the rms of the table's, that the user is warned of; conventional."""

_UNITS_ASSUMED = "assumed-units"


def import_notes(table: SweepTable) -> tuple[str, ...]:
    """What an import warned of, and units that it assumed: a fit is wrong by the factor that they are."""
    findings = [one for one in table.manifest.get("findings") or () if isinstance(one, dict)]
    grave = [one for one in findings if one.get("severity") == "warning" or one.get("code") == _UNITS_ASSUMED]
    return tuple(f"{one.get('text', one.get('sentence', ''))} {one.get('remedy', '')}".strip() for one in grave)


def misfit_notes(model: ActuatorModel, rows: FitRows) -> tuple[str, ...]:
    """Warnings where the model misses the table that it was fitted to."""
    misfit = model.misfit
    assert misfit is not None  # noqa: S101  every fit computes it
    notes = []
    if isinstance(model.magnetics, CoenergySpline) and misfit.force_rms_relative >= COARSE:
        notes.append(
            f"The co-energy misses the sweep's force by {100.0 * misfit.force_rms_relative:.2g} % rms, which a "
            f"diagnosis would inherit. The force changes faster than {len(rows.currents)} currents and "
            f"{len(rows.distances)} distances resolve; sweep more of both, above all where it saturates and at the "
            "smallest distances."
        )
    poor = [
        f"{name} by {amount(share, '')}"
        for name, share in (
            ("flux linkage", misfit.flux_linkage_share),
            ("inductance", misfit.inductance_share),
        )
        if share is not None and share > POOR_CIRCUIT
    ]
    if poor:
        notes.append(
            f"The model misses the table's {' and '.join(poor)}: do not simulate its circuit. "
            "A co-energy (femfit fit without --model) holds both."
        )
    return tuple(notes)
