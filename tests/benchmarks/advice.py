"""How often the measurement that ``femfit suggest`` advises makes a class of names smaller, with the truth still in it.

``python tests/benchmarks/advice.py geometry/emaws-rig.toml -o runs/rig --cases 100`` takes the campaigns of
``other_physics.py development`` with that drawing, directory and seed, measures those whose class holds the truth
beside other names on as advised, and diagnoses them again. Field solutions in the directory are used again.

The advised settings are a further run of the device with its hidden error, with the same meters and another mount,
written below the campaign's rows and diagnosed with them. A direct reading of a parameter has its usual uncertainty; it
takes away the names whose explanations it contradicts by the decision's own criterion. A channel that was not read
before is declared to have the noise that the advice asks for.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from femfit.cli.output import progress
from femfit.core.numerics import FloatArray
from femfit.effects.effect import AddedEffect, Calibration
from femfit.identify.add_effects import add_effects
from femfit.identify.decision.constants import IN_CLASS
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.plan import Experiment
from femfit.identify.separation import assumed_noise, direct_reading, standard_errors
from femfit.identify.suggest import suggest
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.model.with_effects import nominal_of
from femfit.trial.campaigns import prepare_device
from femfit.trial.counts import Share
from femfit.trial.device import Conditions, Device, true_readings
from femfit.trial.judge import says
from femfit.trial.virtual_bench import Meter, measured
from support.trial.campaigns import SetCampaign, measured_campaigns, write_noise
from support.trial.sets import SETS, TruthSet, prepare_set
from support.trial.truth import PassingError, acting_only

_CURRENT_STEP_A = 1e-3
"""Over which an LCR meter's inductance and resistance are taken."""


@dataclass(frozen=True)
class Followed:
    """A campaign whose class had several names, and what the advised measurement made of it."""

    number: int
    hidden: tuple[str, ...]
    group: str
    before: tuple[str, ...]  # The class that holds the truth
    measurement: str  # The first that was advised; empty where none was
    direct: bool  # Whether it reads a parameter directly
    after: tuple[str, ...] = ()  # The class that holds the truth with the measurement; empty where none does
    verdict: str = ""

    @property
    def followed(self) -> bool:
        """Whether the class became smaller and still holds the truth."""
        return 0 < len(self.after) < len(self.before)


@dataclass(frozen=True, eq=False)
class _Bench:
    """A campaign, its device and what it hides, for further measurements."""

    device: Device
    model: ActuatorModel
    measured: SetCampaign
    directory: Path
    rng: np.random.Generator

    def true(self, settings: Conditions) -> dict[str, FloatArray]:
        """Readings without noise; an error that lasts until the campaign's end goes on."""
        campaign, errors = self.measured.campaign, dict(self.measured.errors)
        for name, error in errors.items():
            if isinstance(error, PassingError):
                first, last = error.course(campaign.runs)
                course = (first, last if last < campaign.runs else campaign.runs + 1)
                errors[name] = acting_only(error.whole, lambda runs, course=course: course)
        return true_readings(self.device, settings, campaign.hidden, errors)


def follow_advice(
    device: Device,
    model: ActuatorModel,
    truths: TruthSet,
    directory: Path,
    *,
    cases: int,
    seed: int,
    progress: Callable[[int, int], None],
) -> Iterator[Followed]:
    """Follow the first advice in the campaigns of one hidden error whose class holds it beside other names."""
    for campaign in measured_campaigns(device, cases, seed, truths):
        number = campaign.number
        progress(number, cases)
        if len(campaign.errors) != 1:
            continue
        data = campaign.write(directory / "advice" / f"{number:04d}")
        ((name, right),) = campaign.right.items()
        diagnosis = diagnose(model, data, bootstrap=0)
        before = _class_with(diagnosis, right, several=True)
        if not before:
            continue
        advice = suggest(model, data, diagnosis)
        nothing = Followed(number, (name,), truths.truths[name].group, before, "", False)
        if not advice.suggestions:
            yield nothing
            continue
        first = advice.suggestions[0].experiment
        bench = _Bench(device, model, campaign, data.parent, np.random.default_rng([seed, number, 100]))
        asked = replace(nothing, measurement=first.text, direct=first.calibration is not None)
        if first.calibration is not None:
            after = _read_directly(bench, diagnosis, before, right, first.effect, first.calibration)
            yield replace(asked, after=after, verdict=diagnosis.verdict)
        else:
            again = diagnose(model, _measured_on(bench, first), bootstrap=0)
            yield replace(asked, after=_class_with(again, right), verdict=again.verdict)


def _class_with(diagnosis: Diagnosis, right: Sequence[str], *, several: bool = False) -> tuple[str, ...]:
    """The first class that holds the truth, of those of several names if wanted; empty where none does."""
    classes = [cause.members for cause in diagnosis.missing if len(cause.members) > 1 or not several]
    return next((members for members in classes if says(members, right)), ())


def _measured_on(bench: _Bench, experiment: Experiment) -> Path:
    """The file of the campaign with a further run."""
    rows, campaign, rng = pd.read_csv(bench.directory / "data.csv"), bench.measured.campaign, bench.rng
    new, settings = experiment.rows, campaign.conditions
    n, step = len(new), float(np.median(np.diff(settings.time_s[settings.run == 0])))
    warm = {"coil_C": "coil_temperature_C", "magnet_C": "magnet_temperature_C"}
    heat = {name: new[column].fillna(getattr(settings, name).mean()).to_numpy() for name, column in warm.items()}
    more = Conditions(
        distance=new["distance_m"].to_numpy() + rng.normal(0.0, campaign.mount_m),
        current=new["current_A"].to_numpy(),
        time_s=step * np.arange(n),
        run=np.full(n, campaign.runs),
        campaign_s=settings.campaign_s.max() + step * np.arange(1, n + 1),
        **heat,
    )
    values = _last_readings(bench, more)
    further = new[["current_A", "distance_m", "branch"]].assign(
        run=rows["run"].max() + 1, order=1 + len(settings.run) + np.arange(n), **{warm[k]: v for k, v in heat.items()}
    )
    declared = dict(bench.measured.declared_noise)
    for name in experiment.channels:
        meter = campaign.meters.get(name)
        if meter is None:
            declared[name] = assumed_noise(name, nominal_of(bench.model))
            meter = Meter(declared[name], 0.0, 1.3 * float(np.abs(values[name]).max()))
        further[name] = measured(values[name], meter, more.run, rng)
    columns = [*rows.columns, *(name for name in experiment.channels if name not in rows)]
    path = bench.directory / "measured_on.csv"
    pd.concat([rows, further], ignore_index=True)[columns].to_csv(path, index=False, float_format="%.9g")
    write_noise(path.with_suffix(".toml"), declared)
    return path


def _last_readings(bench: _Bench, more: Conditions) -> dict[str, FloatArray]:
    """Readings of a further run without noise, an LCR meter's among them."""
    settings, n = bench.measured.campaign.conditions, len(more.run)

    def read(shift: float) -> dict[str, FloatArray]:
        last = replace(more, current=more.current + shift)
        names = [setting.name for setting in fields(settings)]
        joined = {name: np.concatenate([getattr(settings, name), getattr(last, name)]) for name in names}
        return {name: values[-n:] for name, values in bench.true(Conditions(**joined)).items()}

    ahead, back = read(_CURRENT_STEP_A), read(-_CURRENT_STEP_A)
    slope = {name: (ahead[name] - back[name]) / (2.0 * _CURRENT_STEP_A) for name in ahead}
    return read(0.0) | {"inductance_H": slope["flux_linkage_Wb"], "resistance_ohm": slope["voltage_V"]}


def _read_directly(
    bench: _Bench,
    diagnosis: Diagnosis,
    before: tuple[str, ...],
    right: Sequence[str],
    effect: str,
    calibration: Calibration,
) -> tuple[str, ...]:
    """The class after a direct reading, if it still holds the truth."""
    uncertainty = np.array(list(calibration.reads.values()))
    truth = _true_effects(bench, diagnosis, right)
    reading = direct_reading(effect, calibration, truth) + uncertainty * bench.rng.standard_normal(len(uncertainty))
    log = {}
    outside = {cause.name for cause in diagnosis.missing} - set(before)
    for explanation in diagnosis.decision.left:
        inside = set(explanation.names) - outside
        if len(inside) != 1 or len(explanation.names) != len(diagnosis.missing):
            continue
        spread = np.hypot(uncertainty, standard_errors(effect, calibration, explanation.fit.effects))
        missed = (reading - direct_reading(effect, calibration, explanation.fit.effects)) / spread
        log[inside.pop()] = explanation.log_evidence - 0.5 * float(missed @ missed) - float(np.log(spread).sum())
    best = max(log.values())
    after = tuple(name for name in before if log.get(name, -np.inf) >= best + np.log(IN_CLASS))
    return after if says(after, right) else ()


def _true_effects(bench: _Bench, diagnosis: Diagnosis, right: Sequence[str]) -> tuple[AddedEffect, ...]:
    """The hidden error as the effect that it is called: fitted to what the campaign would read without noise."""
    settings, meters = bench.measured.campaign.conditions, bench.measured.campaign.meters
    truth = bench.true(settings)
    rows = {
        "run": settings.run + 1,
        "order": 1 + np.arange(len(settings.run)),
        "current_A": settings.current,
        "distance_m": settings.distance,
    }
    rows |= {"coil_temperature_C": settings.coil_C, "magnet_temperature_C": settings.magnet_C}
    path = bench.directory / "without_noise.csv"
    pd.DataFrame(rows | {name: truth[name] for name in meters}).to_csv(path, index=False)
    write_noise(path.with_suffix(".toml"), {name: meter.sigma for name, meter in meters.items()})
    testable = {suspect.name for suspect in diagnosis.ranking if not suspect.note}
    names = [name for name in right if name in testable][:1]
    return add_effects(bench.model, path, names, base="never").added


def advice_lines(followed: Sequence[Followed]) -> list[str]:
    """The counts, and what was missed."""
    advised = [case for case in followed if case.measurement]
    runs, direct = ([case for case in advised if case.direct is kind] for kind in (False, True))
    lines = [f"classes of several names with the truth: {len(followed)}; with advice: {len(advised)}"]
    for name, members in {"all": advised, "a run": runs, "direct": direct}.items():
        share = Share(sum(case.followed for case in members), len(members))
        low, high = share.ci95
        lost = sum(not case.after for case in members)
        same = sum(len(case.after) >= len(case.before) for case in members)
        lines.append(
            f"{name}: smaller and holds the truth in {share.hits} of {share.of} (95 % between {100 * low:.0f} and "
            f"{100 * high:.0f} %); not smaller {same}, truth lost {lost}"
        )
    return lines + [
        f"  {case.number:04d} {', '.join(case.hidden)}: {', '.join(case.before)} -> {', '.join(case.after) or 'none'} "
        f"({case.verdict or 'no advice'}) {case.measurement}"
        for case in followed
        if not case.followed
    ]


def main():
    """Follow the advice and print how often it helped."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drawing", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--set", choices=SETS, default="development")
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    output, workers = options.output, options.workers
    device = prepare_device(options.drawing, output, workers=workers)
    device, truths = prepare_set(options.drawing, device, output, options.set, workers=workers)
    model = read_model(output / "model.json")
    with progress("follow the advice", "campaigns") as show:
        cases = follow_advice(device, model, truths, output, cases=options.cases, seed=options.seed, progress=show)
        followed = list(cases)
    print("\n".join(advice_lines(followed)))


if __name__ == "__main__":
    main()
