"""How far a model is from the table that it was fitted to."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Misfit:
    """How far the model, as it is written, is from the table that it was fitted to.

    Parameters
    ----------
    force_rms_N, force_max_N : float
        Root mean square and maximum of model minus table.
    force_rms_relative : float
        Root mean square of (model - table) / table over the rows.
    force_rms_of_weight : float or None
        ``force_rms_N`` over the moving part's weight, where it can hang within the sweep.
    flux_linkage_rms_Wb, inductance_rms_H, hall_rms_T : float or None
        The same for what else the table has. The inductance is the flux linkage's difference over that of the current,
        from each current to the next.
    against : str
        What it was compared with, for example ``sweep``.
    force_share, flux_linkage_share, inductance_share : float or None
        Each rms over the rms of the table's own values; None in files of earlier versions.
    """

    force_rms_N: float
    force_max_N: float
    force_rms_relative: float
    force_rms_of_weight: float | None
    flux_linkage_rms_Wb: float | None
    hall_rms_T: float | None
    rows: int
    against: str
    inductance_rms_H: float | None = None
    force_share: float | None = None
    flux_linkage_share: float | None = None
    inductance_share: float | None = None
