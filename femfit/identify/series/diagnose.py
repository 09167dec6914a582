"""The diagnosis of a time series: its balances, through the engine of bench tables."""

from femfit.identify.decision.diagnose import DiagnosisOptions, Progress, diagnose
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.series.observations import series_observations
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import TimeSeries


def diagnose_series(
    model: ActuatorModel, series: TimeSeries, options: DiagnosisOptions | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Diagnose a recorded time series.

    Parameters
    ----------
    model : ActuatorModel
        Best the co-energy reference: a law's own shape error is found as missing physics.

    Returns
    -------
    Diagnosis
        Its channels are those of :func:`femfit.identify.series.observations.series_observations`.

    Raises
    ------
    TableError
        If distance or current is missing, or no window can be compared.
    """
    if progress is not None:
        progress("Balancing short windows")
    return diagnose(series_observations(model, series), options, progress)
