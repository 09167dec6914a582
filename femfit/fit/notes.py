"""What a fit says of its data and of its own limits, one plain sentence each."""

import numpy as np

from femfit.core.amount import amount
from femfit.core.arrays import FloatArray
from femfit.fit.rows import FitRows
from femfit.model.actuator_model import ActuatorModel, Misfit
from femfit.model.magnetics import CoenergySpline
from femfit.tables.sweep_table import SweepTable

COARSE = 0.01
"""Misfit of the force, of its rms or of each point's own, that a co-energy's user is warned of; conventional."""

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
    if isinstance(model.magnetics, CoenergySpline):
        notes += _finer_sweep(model.magnetics, misfit, rows)
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


def _finer_sweep(magnetics: CoenergySpline, misfit: Misfit, rows: FitRows) -> list[str]:
    """Where a co-energy misses its table most, and the distances and currents that halve the intervals around it.

    The largest error in newtons is asked for even where errors relative to each point's own force are what is poor:
    points added there also help between the points, where points added at the smallest forces do not.
    """
    shares = ((misfit.force_share or 0.0, "its rms"), (misfit.force_rms_relative, "each point's own force (rms)"))
    poor = next((pair for pair in shares if pair[0] >= COARSE), None)
    if poor is None:
        return []
    worst = np.argmax(np.abs(magnetics.force(rows.distance, rows.current) - rows.force))
    d, i = rows.distance[worst], rows.current[worst]
    more_d, more_i = 1e3 * _middles(rows.distances, d), _middles(rows.currents, i)
    return [
        (
            f"The sweep is too coarse for its force: the co-energy misses it by {amount(poor[0], '')} of {poor[1]}, "
            f"most at {1e3 * d:.4g} mm and {i:.4g} A, and a diagnosis inherits that. Add to [sweep] the distances "
            f"{' and '.join(f'{x:.4g}' for x in more_d)} mm and the currents "
            f"{' and '.join(f'{x:.4g}' for x in more_i)} A, then sweep and fit again."
        )
    ]


def _middles(axis: FloatArray, at: float) -> FloatArray:
    """The middles of the intervals on both sides of a value of an axis."""
    k = int(np.searchsorted(axis, at))
    around = axis[max(k - 1, 0) : k + 2]
    return np.asarray(0.5 * (around[1:] + around[:-1]))
