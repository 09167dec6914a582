"""A recorded log through the filters of a model."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from femfit.core.errors import FilterError, MissingPartError, TableError
from femfit.core.results import Finding
from femfit.core.text import counted
from femfit.estimate.build_filter import FILTERS, filter_of, noise_of, resting_filter
from femfit.estimate.consistency import beside, can_be_filtered, estimates_beside, innovations_of
from femfit.estimate.constants import AT_STOP, LEAST_JUDGED, NOISE_SAMPLES
from femfit.estimate.find_noise import find_noise
from femfit.estimate.noise import FilterNoise
from femfit.estimate.observation import Observation, OneFilter
from femfit.estimate.prepare import Prepared, prepare
from femfit.estimate.process import FilterOutcome
from femfit.estimate.record_checks import suspect_record
from femfit.estimate.run_filter import replay
from femfit.estimate.seating import find_seatings
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.tables.measurement import Measurement, TimeSeries
from femfit.tables.measurement_file import read_measurement

NO_NOISE_FOUND = Finding(
    "no-noise-found",
    "warning",
    f"The filter runs through no stretch of {LEAST_JUDGED} samples, so the noise in the record was not sought.",
    "Give a longer record, or one with a shorter step.",
)


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
        ``ukf``, ``ekf``, or ``ukf4`` and ``ekf4``, which estimate a bias as well; several are placed side by side.
    sensors : sequence of str or None
        Which sensors the filter reads; where None those of the drawing that the record has, or its current and distance
        where it has none of them. Those it does not read check it.
    biases : sequence of str or None
        Whose bias ``ukf4`` and ``ekf4`` estimate; the Hall element's, or else the first sensor's that reads no current.
    noise : FilterNoise or None
        Derived from the model and the record where None.
    find : bool
        Whether to look for the noise that the record shows.

    Raises
    ------
    TableError
        If the record lacks the voltage or every sensor.
    FilterError
        If a filter is unknown, or the coil too fast for the record's step.

    Examples
    --------
    >>> import femfit as ff
    >>> loop = ff.close_loop("model.json", runs=1, seconds=0.5, rng=1)
    >>> loop.write_csv("log.csv")
    >>> seen = ff.observe("model.json", "log.csv", find=False)
    >>> print(str(seen).splitlines()[0])
    ukf: consistent. It claims the distance to 27 µm.
    """
    model = model_of(model)
    series = read_measurement(record) if isinstance(record, str | Path) else record
    if not isinstance(series, TimeSeries):
        raise TableError(
            f"A filter needs a record over time; {series.source} has no column time_s. Say which column it is with "
            "--column HEADER=time_s."
        )
    names = (filter,) if isinstance(filter, str) else tuple(filter)
    unknown = [name for name in names if name not in FILTERS]
    if unknown or not names:
        raise FilterError(f"A filter must be one of {', '.join(FILTERS)}; instead received {filter!r}.")
    prepared = prepare(model, series, sensors)
    noise = noise_of(prepared, noise)
    runs = [_run(prepared, name, biases, noise) for name in names]
    mended = None
    if not runs[0].trusted and any(resistance.contradicts for resistance in prepared.resistances):
        mended = _run(_with_resistances(prepared), names[0], biases, noise)
    shown = find_noise(runs[0].built, prepared, runs[0].replayed) if find else None
    return Observation(
        model=replace(prepared.model, sample_time_s=model.sample_time_s),
        source=series.source,
        sensors=prepared.sensors,
        time_s=prepared.time_s,
        recorded=prepared.recorded,
        filters=tuple(runs),
        findings=(
            *suspect_record(prepared.model, series),
            *prepared.findings,
            *_told_by_estimate(prepared, runs[0]),
            *([NO_NOISE_FOUND] if find and shown is None else []),
        ),
        noise=shown,
        seatings=find_seatings(prepared, runs[0].built, runs[0].replayed),
        resistances=prepared.resistances,
        with_resistances=mended,
    )


def filtered(model: ActuatorModel, series: TimeSeries) -> OneFilter | None:
    """The first samples of a record through the unscented filter; None where the model has no filter for it."""
    if not can_be_filtered(model, series):
        return None
    short = {name: values[:NOISE_SAMPLES] for name, values in series.clipped.items()}
    series = replace(series, rows=series.rows[:NOISE_SAMPLES], clipped=short)
    try:
        return observe(model, series, find=False).filters[0]
    except (FilterError, MissingPartError, TableError):  # as of a coil too fast for the record, or a force law alone
        return None


def _with_resistances(prepared: Prepared) -> Prepared:
    """The record with a model whose resistances are those that steady currents show."""
    ohm = {resistance.circuit: resistance.ohm for resistance in prepared.resistances if resistance.contradicts}
    circuits = tuple(
        replace(circuit, resistance_ohm=ohm.get(circuit.name, circuit.resistance_ohm))
        for circuit in prepared.model.circuits
    )
    return replace(prepared, model=replace(prepared.model, circuits=circuits))


def _run(prepared: Prepared, name: str, biases: Sequence[str] | None, noise: FilterNoise) -> OneFilter:
    """The record through one filter."""
    model, built = prepared.model, filter_of(prepared, name, biases, noise)
    replayed = replay(built, prepared.log, resting_filter(prepared, built))
    judged = [
        innovations_of(reading.name, reading.unit, replayed.innovation[:, k], replayed.variance[:, k])
        for k, reading in enumerate(prepared.readings)
    ]
    used = {reading.column for reading in prepared.readings}
    estimates = estimates_beside(prepared, replayed)
    compared = [
        beside(column, column in used, prepared.recorded[column], values, model.sample_time_s)
        for column, values in estimates.items()
    ]
    lost = np.flatnonzero(replayed.outcome != FilterOutcome.RUNNING)
    return OneFilter(
        name=name,
        built=built,
        replayed=replayed,
        innovations=tuple(innovations for innovations in judged if innovations is not None),
        beside=tuple(channel for channel in compared if channel is not None),
        estimates=estimates,
        lost_at_s=float(prepared.time_s[lost[0]]) if len(lost) else None,
        outcome=FilterOutcome(int(replayed.outcome[lost[0]])) if len(lost) else FilterOutcome.RUNNING,
    )


def _told_by_estimate(prepared: Prepared, run: OneFilter) -> list[Finding]:
    """Rests on a stop where no recorded distance tells them, and where the model leaves its validity domain.

    An estimate that is not consistent with the readings, or does not claim to know the distance, tells no rest.
    """
    model, mean, findings = prepared.model, run.replayed.mean, []
    near, far = model.require_motion().ends
    samples = len(mean)
    box, deviation = model.validity, run.replayed.deviation
    least = AT_STOP * (box.distance_max_m - box.distance_min_m)
    close = np.where(deviation[:, 0] <= least, deviation[:, 0], -1.0)
    if "distance_m" not in prepared.recorded and run.trusted:
        for side, stop in (("near", near), ("far", far)):
            resting = (np.abs(mean[:, 0] - stop) <= close) & (np.abs(mean[:, 1]) <= 3.0 * deviation[:, 1])
            if resting.any():
                share = f"{100.0 * resting.mean():.3g} % of the {counted(samples, 'sample')}"
                findings.append(Finding("at-stop", "info", f"The body rests on the {side} stop in {share}."))
    with np.errstate(invalid="ignore"):  # by more than the estimate is uncertain, and than a body lies on its stop
        bounded = [0, *range(2, 2 + len(model.circuits))]
        limits = np.array([(box.distance_min_m, box.distance_max_m), *box.current_limits_A])[: len(bounded)]
        bounded_states = mean[:, bounded]
        beyond = np.maximum(limits[:, 0] - bounded_states, bounded_states - limits[:, 1])
        beyond -= np.fmax(3.0 * deviation[:, bounded], AT_STOP * np.ptp(limits, axis=1))
        outside = (beyond > 0.0).any(axis=1) | ~np.isfinite(bounded_states).all(axis=1)
    if outside.any():
        ranges = " and ".join(
            [f"{1e3 * box.distance_min_m:.3g} to {1e3 * box.distance_max_m:.3g} mm"]
            + [f"{low:.3g} to {high:.3g} A" for low, high in limits[1:]]
        )
        findings.append(
            Finding(
                "outside-domain",
                "warning",
                f"{counted(int(outside.sum()), 'estimate')} of {samples} lie outside of the model's validity domain, "
                f"{ranges}.",
                "Sweep wider, or leave the stretch out.",
            )
        )
    return findings
