"""The rows of a study of closed loops."""

from collections.abc import Mapping
from dataclasses import dataclass

from femfit.core.numerics import FloatArray
from femfit.estimate.noise import ConsistencyBand
from femfit.simulation.experiment import Experiment

SEEN = 2.0
"""Derived: standard errors beyond which a mean is more than chance, 95 %."""


@dataclass(frozen=True, eq=False)
class StepSeries:
    """One recorded run over reference steps."""

    controller: str
    observer: str
    time_s: FloatArray
    reference_m: FloatArray
    true_m: FloatArray
    direct_m: FloatArray
    estimated_m: FloatArray
    voltage_V: FloatArray
    current_A: FloatArray


@dataclass(frozen=True)
class StepRow:
    """How well one measurement follows the true distance over the reference steps."""

    controller: str
    measurement: str  # ``direct`` or the filter that feeds the loop
    rms_m: float  # Over the runs that were held; NaN if none was
    held: int
    runs: int


@dataclass(frozen=True)
class HoldRow:
    """Direct against filtered noise at rest."""

    controller: str
    filter: str
    distance_m: float
    direct_rms_m: float
    filtered_rms_m: float
    # Direct over filtered rms, and 1/sqrt(2 lambda t_s), which no filter of white noise passes
    ratio: float
    bound: float
    normalised_innovation_squared: float
    innovation_band: ConsistencyBand  # 95 % for the mean of the normalised innovations squared
    held: int
    runs: int


@dataclass(frozen=True)
class FaultRow:
    """How the runs of one experiment ended, with the means of those that were held."""

    experiment: Experiment
    runs: int
    outcomes: Mapping[str, int]  # Number of runs by the name of their :class:`~femfit.simulation.loop.LoopOutcome`
    last_loss_s: float | None  # When the last of the lost runs was lost
    # Estimated minus true distance, and true distance minus reference; NaN if no run was held
    estimate_rms_m: float
    estimate_bias_m: float
    position_bias_m: float
    # How far the body moved against the loop without the fault on the same noise, and the standard error of that; NaN
    # without such a loop, or if fewer than two runs were held in both
    position_shift_m: float
    shift_error_m: float

    @property
    def held(self) -> int:
        """Number of runs that were held."""
        return self.outcomes.get("HELD", 0)

    @property
    def moved(self) -> bool:
        """Whether the shift is more than chance."""
        return abs(self.position_shift_m) > SEEN * self.shift_error_m


@dataclass(frozen=True, eq=False)
class SpectrumPair:
    """Amplitudes of direct and filtered distance at rest, so that a sine of amplitude a shows a peak of height a."""

    controller: str
    frequency_Hz: FloatArray
    direct_m: FloatArray
    filtered_m: FloatArray
