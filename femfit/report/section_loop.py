"""The report's section on the closed loop."""

from collections.abc import Iterable

import numpy as np
from markupsafe import Markup

from femfit.report.content import ReportContent
from femfit.report.embed import svg_uri
from femfit.report.loop_figures import NAMES, spectrum_figure, steps_figure
from femfit.report.numbers import NO_BREAK, NOTHING, percent, plain, quantity, significant
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.simulation.experiment import Experiment
from femfit.simulation.fault import FaultRow
from femfit.simulation.study import ClosedLoopStudy, HoldRow

MM = 1e3
MICRO = 1e6
TITLE = "The closed loop"


def loop_section(content: ReportContent) -> Section:
    """Reference steps, the noise bound, spectra, and what breaks the loop.

    Returns
    -------
    Section
        One sentence where the loop could not be closed.
    """
    study = content.study
    if study is None:
        return Section("loop", TITLE, (text("The loop was not closed: {}", content.why_no_loop),))
    if not any(row.held for row in study.steps):
        return Section("loop", TITLE, (_setting(study), _all_lost(study)))
    blocks: list[Block] = [
        _setting(study),
        *_step_pictures(study),
        _step_table(study),
        *_spectra(study),
        _hold_table(study),
        _bound(study),
        _filters(study),
        _faults(study),
    ]
    return Section("loop", TITLE, tuple(blocks))


def _setting(study: ClosedLoopStudy) -> Block:
    design = study.design
    first, last = design.points[0], design.points[-1]
    one = text(" There is no PID controller: {}", design.why_no_pid) if design.why_no_pid else ""
    alone = text(" The filters stand alone: {}", study.no_direct) if study.no_direct else ""
    return text(
        "The plant is the co-energy model with back-EMF, the sensor the Hall characteristic with {} and the "
        "converter. The controllers take distance, velocity and current from the filter; their gains "
        "follow from the model. Between {} and {} mm the body hangs at {} to {} with an unstable pole of {} to {} "
        "rad/s. Seed {}.{}{}",
        f"{quantity(design.noise_V, 'V')} rms of white noise" if design.noise_V else "no noise",
        plain(MM * first.distance_m),
        plain(MM * last.distance_m),
        quantity(first.voltage_V, "V"),
        quantity(last.voltage_V, "V"),
        plain(first.mechanical_pole_rad_s, 3),
        plain(last.mechanical_pole_rad_s, 3),
        study.seed,
        one,
        alone,
    )


def _all_lost(study: ClosedLoopStudy) -> Block:
    """Where the drawn runs ended, in place of pictures and means of nothing."""
    box = study.design.model.validity
    ends = []
    for series in study.series:
        known = np.flatnonzero(np.isfinite(series.true_m))
        if known.size:
            last = int(known[-1])
            ends.append(
                text(
                    "{}, last at {} mm and {} A after {}",
                    NAMES[series.controller],
                    plain(MM * series.true_m[last], 4),
                    plain(series.current_A[last], 3),
                    quantity(float(series.time_s[last]), "s"),
                )
            )
    return text(
        "Every run of the reference steps was lost{}. The model covers {} to {} mm and {} to {} A; a run that leaves "
        "this box is lost. There is nothing to average and nothing to draw.",
        text(" ({})", Markup("; ").join(ends)) if ends else "",
        plain(MM * box.distance_min_m),
        plain(MM * box.distance_max_m),
        plain(box.current_min_A),
        plain(box.current_max_A),
    )


def _step_pictures(study: ClosedLoopStudy) -> list[Picture]:
    pictures = []
    for series in study.series:
        name = NAMES[series.controller]
        pictures.append(
            Picture(
                f"steps-{series.controller}",
                svg_uri(steps_figure(series), f"steps-{series.controller}"),
                f"Distance over time with the {name} controller, direct measurement and filter.",
                text(
                    "Reference steps with the {} controller fed by the {}: distances, errors of both measurements, "
                    "coil voltage.",
                    name,
                    NAMES[series.observer],
                ),
            )
        )
    return pictures


def _step_table(study: ClosedLoopStudy) -> DataTable:
    controllers = list(dict.fromkeys(row.controller for row in study.steps))
    rows = {(row.measurement, row.controller): row for row in study.steps}
    measurements = list(dict.fromkeys(row.measurement for row in study.steps))
    body = []
    for measurement in measurements:
        cells = [NAMES[measurement]]
        for controller in controllers:
            row = rows[measurement, controller]
            lost = "" if row.held == row.runs else f" ({row.runs - row.held} of {row.runs} runs lost)"
            cells.append(f"{_micro(row.rms_m)}{lost}")
        body.append(tuple(cells))
    if "direct" in measurements:
        ratios = (rows["direct", c].rms_m / rows["ukf", c].rms_m for c in controllers)
        body.append(("direct / UKF", *(plain(ratio, 3) for ratio in ratios)))
    return DataTable(
        text(
            "Rms of true minus measured distance over the reference steps, {} runs each.",
            study.steps[0].runs,
        ),
        ("measurement", *(f"{NAMES[controller]} (µm)" for controller in controllers)),
        tuple(body),
    )


def _micro(value: float) -> str:
    return significant(MICRO * value, 3)


def _spectra(study: ClosedLoopStudy) -> list[Picture]:
    return [
        Picture(
            f"spectrum-{pair.controller}",
            svg_uri(spectrum_figure(pair), f"spectrum-{pair.controller}"),
            f"Spectra of direct and filtered distance with the {NAMES[pair.controller]} controller.",
            text(
                "Spectra at rest with the {} controller: at low frequency both show the body's own motion, above it "
                "the filter leaves the sensor's white noise behind.",
                NAMES[pair.controller],
            ),
        )
        for pair in study.spectra
    ]


def _hold_table(study: ClosedLoopStudy) -> DataTable:
    header = (
        "controller, filter",
        "distance",
        "direct (µm rms)",
        "filter (µm rms)",
        "ratio",
        "bound",
        "innovations (95 % band)",
    )
    return DataTable(
        Markup("At rest, at both ends of the reference: noise of direct measurement and filter from the same readings"),
        header,
        tuple(
            (
                f"{NAMES[row.controller]}, {NAMES[row.filter]}",
                f"{plain(MM * row.distance_m)}{NO_BREAK}mm",
                _micro(row.direct_rms_m),
                _micro(row.filtered_rms_m),
                significant(row.ratio),
                significant(row.bound),
                _innovations(row),
            )
            for row in study.holds
        ),
    )


def _innovations(row: HoldRow) -> str:
    band = row.innovation_band
    return f"{significant(row.normalised_innovation_squared, 4)} ({band.lower:.3f} … {band.upper:.3f})"


def _bound(study: ClosedLoopStudy) -> Block:
    shares = np.array([row.ratio / row.bound for row in study.holds if row.held])
    if not shares.size:
        return Markup("No run was held at rest, so that no noise can be compared.")
    inside = sum(row.innovation_band.contains(row.normalised_innovation_squared) for row in study.holds)
    reached = text(
        " The filters reach {} to {} of it (statistics of a finite record can pass it by a little).",
        percent(float(shares.min()), 3),
        percent(float(shares.max()), 3),
    )
    return text(
        "The bound is 1/√(2 λ t<sub>s</sub>): no filter gains more against white noise on a body with the unstable "
        "pole λ.{} Of {} mean normalised innovations, {} lie in their 95 % band, which is what tells a filter that "
        "knows its own error.",
        "" if study.no_direct else reached,
        len(study.holds),
        inside,
    )


def _filters(study: ClosedLoopStudy) -> Block:
    return text(
        "UKF and EKF on the same noise.{} With a wrong first estimate: {}.",
        _filters_at_rest(study),
        "; ".join(_acquired(study.acquisition)),
    )


def _filters_at_rest(study: ClosedLoopStudy) -> str:
    held = [row for row in study.holds if row.held]
    ekf = {(row.controller, row.distance_m): row.filtered_rms_m for row in held if row.filter == "ekf"}
    apart = [
        abs(ekf[row.controller, row.distance_m] / row.filtered_rms_m - 1.0)
        for row in held
        if row.filter == "ukf" and (row.controller, row.distance_m) in ekf
    ]
    return f" At rest their noise differs by {percent(max(apart))} at most." if apart else ""


def _acquired(rows: Iterable[FaultRow]) -> list[str]:
    found = []
    for row in rows:
        believed = row.experiment.believed_m
        start = "" if believed is None else f" believed at {plain(MM * believed)} mm"
        body = f"body at {plain(MM * row.experiment.targets_m[0])} mm{start}"
        found.append(f"{NAMES[row.experiment.observer]}, {body}, {row.held} of {row.runs} held")
    return found


def _faults(study: ClosedLoopStudy) -> DataTable:
    """A row a loop and fault, a column a distance."""
    entries = [(row.experiment, _consequence(row)) for row in study.faults]
    distances = sorted({experiment.targets_m[0] for experiment, _ in entries})
    cells: dict[tuple[str, str], dict[float, str]] = {}
    for experiment, end in entries:
        key = (f"{NAMES[experiment.controller]}, {NAMES[experiment.observer]}", _fault(experiment))
        cells.setdefault(key, {})[experiment.targets_m[0]] = end
    return DataTable(
        Markup("What breaks the loop, and what it costs: the body's shift against the loop without the fault"),
        ("loop", "fault", *(f"at {plain(MM * d)} mm" for d in distances)),
        tuple((*key, *(ends.get(d, NOTHING) for d in distances)) for key, ends in cells.items()),
    )


def _fault(experiment: Experiment) -> str:
    if experiment.offset_V:
        return f"Hall offset {quantity(experiment.offset_V, 'V', 2)}"
    if experiment.force_scale != 1.0:
        return f"true force {percent(experiment.force_scale - 1.0)} above the model's"
    cutoff = experiment.velocity_cutoff_rad_s
    derivative = f"derivative below {cutoff:.0f} rad/s" if np.isfinite(cutoff) else "raw derivative"
    return derivative if experiment.noise_V is None else f"{derivative}, noise {quantity(experiment.noise_V, 'V', 2)}"


def _consequence(row: FaultRow) -> str:
    lost = ""
    if row.held < row.runs:
        names = ", ".join(name.lower().replace("_", " ") for name in row.outcomes if name != "HELD")
        when = f"within {quantity(row.last_loss_s, 's')}" if row.last_loss_s else "at once"
        lost = f"{row.runs - row.held} of {row.runs} lost {when} ({names})"
    if np.isfinite(row.position_shift_m):
        shift = f"{_micro(row.position_shift_m)} ± {significant(MICRO * row.shift_error_m, 2)} µm"
        return f"{shift}; {lost}" if lost else shift
    return lost or f"all {row.runs} held, measured within {_micro(row.estimate_rms_m)} µm rms"
