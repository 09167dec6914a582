"""A recorded log through the filters of a model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from femfit.core.errors import TableError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.public import require_known
from femfit.core.results import Finding, Plotted, Result
from femfit.estimate.constants import AT_STOP, LEAST_JUDGED
from femfit.estimate.find_noise import FoundNoise, find_noise
from femfit.estimate.follow import FILTERS, OneFilter, follow
from femfit.estimate.noise import FilterNoise
from femfit.estimate.prepare import prepare
from femfit.estimate.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.sample_step import COARSE
from femfit.tables.findings import finding
from femfit.tables.measurement import Measurement, TimeSeries
from femfit.tables.measurement_file import read_measurement

NO_NOISE_FOUND = finding("no-noise-found", least=LEAST_JUDGED)


@dataclass(frozen=True, eq=False, repr=False)
class Observation(Plotted, Result):
    """A recorded log as filters saw it.

    Examples
    --------
    >>> import femfit as ff
    >>> ff.close_loop("model.json", targets_m=(0.022,), runs=1, seconds=0.5, rng=1).write_csv("log.csv")
    >>> seen = ff.observe("model.json", "log.csv", find=False)
    >>> seen.filters[0].name
    'ukf'
    """

    data = "source", "samples=time_s.size", "sensors", "filters", "noise", "findings=remarks"

    model: ActuatorModel
    source: str
    sensors: tuple[str, ...]
    time_s: FloatArray
    recorded: Mapping[str, FloatArray]
    filters: tuple[OneFilter, ...]
    findings: tuple[Finding, ...]
    noise: FoundNoise | None

    def __str__(self) -> str:
        return sentence("observe", "observation", self)

    @property
    def table(self) -> pd.DataFrame:
        """Recorded channels, and for each filter its estimate, deviations and normalised innovations."""
        columns: dict[str, FloatArray] = {"time_s": self.time_s, **self.recorded}
        for run in self.filters:
            for k, name in enumerate(run.built.process.names):
                columns[f"{run.name}_{name}"] = run.replayed.mean[:, k]
                columns[f"{run.name}_deviation_{name}"] = run.replayed.deviation[:, k]
            for k, output in enumerate(run.built.process.outputs):
                ratio = run.replayed.innovation[:, k] / np.sqrt(run.replayed.variance[:, k])
                columns[f"{run.name}_innovation_{output.name}"] = ratio
        return pd.DataFrame(columns)

    @property
    def remarks(self) -> list[str]:
        """The findings in words."""
        return [str(finding) for finding in self.findings]


def observe(
    model: ActuatorModel | str | Path,
    record: Measurement | str | Path,
    *,
    filter: str | Sequence[str] = "ukf",  # noqa: A002  the word that users look for
    sensors: Sequence[str] | None = None,
    biases: Sequence[str] | None = None,
    noise: FilterNoise | None = None,
    find: bool = True,
) -> Observation:
    """Run a recorded log through one or more filters: estimate, innovations, and the noise that the log shows.

    Parameters
    ----------
    model : ActuatorModel, str or Path
        With circuit and motion.
    record : TimeSeries, str or Path
        With the commanded voltage, and a channel that a sensor of the model reads; a current or a distance is a sensor
        of its own where the model has none.
    filter : str or sequence of str
        Filters, placed side by side: ukf, ekf, or ukf4 and ekf4, which estimate a bias as a further state.
    sensors : sequence of str or None
        Sensors that the filters read; by default those of the drawing that the record has, or its current and distance
        where it has none of them; the others check the estimate.
    biases : sequence of str or None
        Sensors whose bias ukf4 and ekf4 estimate; by default the Hall element, or else the first that reads no current.
    noise : FilterNoise or None
        Derived from the model and the record where None.
    find : bool
        Whether to look for the noise that the record shows.

    Raises
    ------
    TableError
        If the record lacks the voltage or every sensor.
    UsageError
        If a filter is unknown, or a bias that no filter estimates.
    FilterError
        If the coil is too fast for the record's step.

    Examples
    --------
    >>> import femfit as ff
    >>> loop = ff.close_loop("model.json", targets_m=(0.022,), runs=1, seconds=0.5, rng=1)
    >>> loop.write_csv("log.csv")
    >>> seen = ff.observe("model.json", "log.csv", find=False)
    >>> len(seen.table)
    1000
    """
    model = model_of(model)
    series = read_measurement(record) if isinstance(record, str | Path) else record
    if not isinstance(series, TimeSeries):
        raise TableError(
            f"A filter needs a record over time; {series.source} has no column time_s. Say which column it is with "
            "--column HEADER=time_s."
        )
    names = (filter,) if isinstance(filter, str) else tuple(filter)
    require_known("A filter", names or [""], FILTERS)
    prepared = prepare(model, series, sensors)
    require_known("A bias", biases or (), prepared.names)
    if biases and not any(FILTERS[name][1] for name in names):
        raise UsageError(f"No bias is estimated by {', '.join(names)}. Leave --biases out, or give --filter ukf4.")
    runs = [follow(prepared, name, biases, noise) for name in names]
    shown = find_noise(runs[0]) if find else None
    error = prepared.model.sample_step.error  # of steps that do not follow what happens within a sample
    share = f"{100.0 * error:.2g} %" if np.isfinite(error) else "all"
    coarse = [finding("coarse-sample", share=share, size=error)] if not error <= COARSE else []
    return Observation(
        model=replace(prepared.model, sample_time_s=model.sample_time_s),
        source=series.source,
        sensors=prepared.names,
        time_s=prepared.time_s,
        recorded=prepared.recorded,
        filters=tuple(runs),
        findings=(
            *prepared.findings,
            *_told_by_estimate(runs[0]),
            *coarse,
            *([NO_NOISE_FOUND] if find and shown is None else []),
        ),
        noise=shown,
    )


def _told_by_estimate(run: OneFilter) -> list[Finding]:
    """Rests on a stop where no recorded distance tells them, and where the model leaves its validity domain.

    An estimate that is not consistent with the readings, or does not claim to know the distance, tells no rest.
    """
    model, mean, deviation, findings = run.prepared.model, run.replayed.mean, run.replayed.deviation, []
    box, samples = model.validity, len(mean)
    if "distance_m" not in run.prepared.recorded and run.trusted:
        certain = deviation[:, 0] <= AT_STOP * (box.distance_max_m - box.distance_min_m)
        for side, stop in zip(("near", "far"), model.require_motion().ends, strict=True):
            resting = (
                certain & (np.abs(mean[:, 0] - stop) <= deviation[:, 0]) & (np.abs(mean[:, 1]) <= 3.0 * deviation[:, 1])
            )
            if resting.any():
                share = 100.0 * float(resting.mean())
                findings.append(finding("at-stop estimate", side=side, share=share, samples=samples))
    bounded = [0, *range(2, 2 + len(model.circuits))]
    limits = np.array([(box.distance_min_m, box.distance_max_m), *box.current_limits_A])[: len(bounded)]
    lowest, highest = limits.T
    # By more than the estimate is uncertain, and than a body lies on its stop
    slack = np.fmax(3.0 * deviation[:, bounded], AT_STOP * (highest - lowest))
    within = (mean[:, bounded] >= lowest - slack) & (mean[:, bounded] <= highest + slack)
    if outside := int((~within.all(axis=1)).sum()):
        ranges = [f"{1e3 * box.distance_min_m:.3g} to {1e3 * box.distance_max_m:.3g} mm"]
        ranges += [f"{low:.3g} to {high:.3g} A" for low, high in limits[1:]]
        findings.append(finding("outside-domain", outside=outside, samples=f"{samples}", ranges=" and ".join(ranges)))
    return findings
