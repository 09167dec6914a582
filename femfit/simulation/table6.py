"""The paper's Table 6 and the bound that it cannot pass.

The paper's ratios, 8.1 and 9.35, lie beyond 1/sqrt(2 lambda t_s) = 5.2 .. 6.0 between 22 and 30 mm, which no filter of
white noise passes; its direct rms are an input (the sensor's noise and where the body hung), not a result.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, Table 6.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.consistency import ConsistencyBand, consistency_band
from femfit.filters.theory import noise_ratio_bound
from femfit.simulation.design import LoopDesign
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopResult

PAPER_RMS_M = {
    ("backstepping", "direct"): 12.32e-5,
    ("backstepping", "ukf"): 1.52e-5,
    ("pid", "direct"): 15.71e-5,
    ("pid", "ukf"): 1.68e-5,
}
"""Table 6, by controller and measurement."""


@dataclass(frozen=True)
class Table6Row:
    """One entry of Table 6.

    Parameters
    ----------
    controller, measurement : str
        Of the closed loop (always fed by the filter), and what is compared with the true distance.
    rms_m : float
        Over the whole run; NaN if no run was held.
    held, runs : int
        How many of the runs were held; only they count.
    """

    controller: str
    measurement: str
    rms_m: float
    paper_rms_m: float | None
    held: int
    runs: int


@dataclass(frozen=True)
class HoldRow:
    """Direct against filtered noise at rest.

    Parameters
    ----------
    ratio, bound : float
        Direct over filtered, and 1/sqrt(2 lambda t_s).
    innovation_band : ConsistencyBand
        95 % for that mean.
    """

    controller: str
    filter: str
    distance_m: float
    direct_rms_m: float
    filtered_rms_m: float
    ratio: float
    bound: float
    normalised_innovation_squared: float
    innovation_band: ConsistencyBand
    held: int
    runs: int


def table6_row(controller: str, measurement: str, result: LoopResult, distance: FloatArray) -> Table6Row:
    """RMS of a measurement over the whole run.

    Parameters
    ----------
    distance : array, shape (steps, runs)
        The measurement, in m.

    Returns
    -------
    Table6Row
        With the paper's entry where it has one.
    """
    held = result.held
    return Table6Row(
        controller=controller,
        measurement=measurement,
        rms_m=_rms(distance[:, held] - result.series.distance_m[:, held]),
        paper_rms_m=PAPER_RMS_M.get((controller, measurement)),
        held=int(held.sum()),
        runs=len(held),
    )


def hold_row(
    design: LoopDesign, experiment: Experiment, result: LoopResult, direct: FloatArray, window: slice
) -> HoldRow:
    """Direct and filtered rms of a hold.

    Parameters
    ----------
    direct : array, shape (steps, runs)
        Direct measurement in m.
    """
    held, distance = result.held, experiment.targets_m[0]
    direct_rms = _rms((direct - result.series.distance_m)[window][:, held])
    filtered_rms = _root_mean(result.windows[0].estimate_rms_m[held] ** 2)
    quality = result.windows[0].normalised_innovation_squared[held]
    return HoldRow(
        controller=experiment.controller,
        filter=experiment.observer,
        distance_m=distance,
        direct_rms_m=direct_rms,
        filtered_rms_m=filtered_rms,
        ratio=direct_rms / filtered_rms,
        bound=noise_ratio_bound(design.model, distance),
        normalised_innovation_squared=float(np.mean(quality)) if quality.size else np.nan,
        innovation_band=consistency_band(max(1, int(held.sum())) * (window.stop - window.start)),
        held=int(held.sum()),
        runs=len(held),
    )


def _rms(error: FloatArray) -> float:
    return _root_mean(error**2)


def _root_mean(squares: FloatArray) -> float:
    return float(np.sqrt(np.mean(squares))) if squares.size else float("nan")
