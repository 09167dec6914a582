"""The diagnosis of a time series: its balances, through the engine of bench tables."""

from femfit.core.time_series import TimeSeries
from femfit.diagnose.diagnose import DiagnosisOptions, Progress, diagnose
from femfit.diagnose.diagnosis import Diagnosis
from femfit.diagnose.series.observations import series_observations
from femfit.model.actuator_model import ActuatorModel


def diagnose_series(
    model: ActuatorModel, series: TimeSeries, options: DiagnosisOptions | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Diagnose a recorded time series.

    Parameters
    ----------
    model : ActuatorModel
        Best the co-energy reference: a law's own shape error is found as missing physics.
    series : TimeSeries
        As read.
    options : DiagnosisOptions or None
        Defaults where None.
    progress : callable or None
        Receives what is being done.

    Returns
    -------
    Diagnosis
        Its channels are those of :func:`femfit.diagnose.series.observations.series_observations`.

    Raises
    ------
    TableError
        If distance or current is missing, or no window can be compared.
    """
    if progress is not None:
        progress("Balancing short windows")
    return diagnose(series_observations(model, series), options, progress)
