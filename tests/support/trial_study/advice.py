"""Whether the measurement that ``femfit suggest`` advises first makes a class of names smaller and keeps the truth.

A campaign of ``femfit trial --set`` whose class has several names is measured on by the same virtual bench: the advised
settings are a further run of the device with its hidden error, with the same meters and another mount, written below
the campaign's rows and diagnosed with them. A direct reading of a parameter has its usual uncertainty; it takes away
the names whose explanations it contradicts by the decision's own criterion. A channel that was not read before is
declared to have the noise that the advice asks for.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.effects.effect import AddedEffect, Calibration
from femfit.identify.decision.constants import IN_CLASS
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.experiments.direct import direct_reading, standard_errors
from femfit.identify.experiments.noise import assumed_noise
from femfit.identify.experiments.possible import Experiment
from femfit.identify.experiments.suggest import suggest
from femfit.identify.refit.add_effects import add_effects
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import nominal_of
from femfit.trial.campaigns import TruthSet, measured_campaigns, right_names, write_campaign
from femfit.trial.counts import Share
from femfit.trial.device import Conditions, Device, HiddenError, true_readings
from femfit.trial.judge import says
from femfit.trial.truths.course import acting_only
from femfit.trial.virtual_bench import Campaign, Meter, measured

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
    campaign: Campaign
    errors: Mapping[str, HiddenError]
    place: Path
    rng: np.random.Generator

    def true(self, at: Conditions) -> dict[str, FloatArray]:
        """Readings without noise; an error that lasts until the campaign's end goes on."""
        runs, acting = self.campaign.runs, dict(self.errors)
        for name, (first, last) in self.campaign.when.items():
            acting[name] = acting_only(self.errors[name], (first, last if last < runs else runs + 1))
        return true_readings(self.device, at, self.campaign.hidden, acting)


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
    for number, campaign, errors in measured_campaigns(device, cases, seed, truths):
        progress(number, cases)
        if len(errors) != 1:
            continue
        place = directory / "advice" / f"{number:04d}"
        write_campaign(campaign, place, errors, truths)
        right = [one for name, error in errors.items() for one in right_names(name, error)]
        found = diagnose(model, place / "data.csv", bootstrap=0)
        before = _class_with(found, right, several=True)
        if not before:
            continue
        advice = suggest(model, place / "data.csv", found)
        group = " and ".join(truths.truths[name].group for name in errors)
        nothing = Followed(number, tuple(campaign.hidden), group, before, "", False)
        if not advice.suggestions:
            yield nothing
            continue
        first = advice.suggestions[0].experiment
        bench = _Bench(device, model, campaign, errors, place, np.random.default_rng([seed, number, 100]))
        asked = replace(nothing, measurement=first.text, direct=first.calibration is not None)
        if first.calibration is not None:
            after = _read_directly(bench, found, before, right, first.effect, first.calibration)
            yield replace(asked, after=after, verdict=found.verdict)
        else:
            again = diagnose(model, _measured_on(bench, first), bootstrap=0)
            yield replace(asked, after=_class_with(again, right), verdict=again.verdict)


def _class_with(found: Diagnosis, right: Sequence[str], *, several: bool = False) -> tuple[str, ...]:
    """The first class that holds the truth, of those of several names if wanted; empty where none does."""
    classes = [one.members for one in found.missing if len(one.members) > 1 or not several]
    return next((members for members in classes if says(members, right)), ())


def _measured_on(bench: _Bench, experiment: Experiment) -> Path:
    """The file of the campaign with a further run."""
    rows, campaign, rng = pd.read_csv(bench.place / "data.csv"), bench.campaign, bench.rng
    new, at = experiment.rows, campaign.at
    n, step = len(new), float(np.median(np.diff(at.time_s[at.run == 0])))
    warm = {"coil_C": "coil_temperature_C", "magnet_C": "magnet_temperature_C"}
    heat = {name: new[column].fillna(getattr(at, name).mean()).to_numpy() for name, column in warm.items()}
    more = Conditions(
        distance=new["distance_m"].to_numpy() + rng.normal(0.0, campaign.mount_m),
        current=new["current_A"].to_numpy(),
        time_s=step * np.arange(n),
        run=np.full(n, campaign.runs),
        campaign_s=at.campaign_s.max() + step * np.arange(1, n + 1),
        **heat,
    )
    values = _last_readings(bench, more)
    further = new[["current_A", "distance_m", "branch"]].assign(
        run=rows["run"].max() + 1, order=1 + len(at.run) + np.arange(n), **{warm[k]: v for k, v in heat.items()}
    )
    declared = dict(campaign.declared_noise)
    for name in experiment.channels:
        meter = campaign.meters.get(name)
        if meter is None:
            declared[name] = assumed_noise(name, nominal_of(bench.model))
            meter = Meter(declared[name], 0.0, 1.3 * float(np.abs(values[name]).max()))
        further[name] = measured(values[name], meter, more.run, rng)
    columns = [*rows.columns, *(name for name in experiment.channels if name not in rows)]
    path = bench.place / "measured_on.csv"
    pd.concat([rows, further], ignore_index=True)[columns].to_csv(path, index=False, float_format="%.9g")
    path.with_suffix(".toml").write_text("".join(f"{k} = {v:.4g}\n" for k, v in declared.items()), encoding="utf-8")
    return path


def _last_readings(bench: _Bench, more: Conditions) -> dict[str, FloatArray]:
    """Readings of a further run without noise, an LCR meter's among them."""
    at, n = bench.campaign.at, len(more.run)

    def read(shift: float) -> dict[str, FloatArray]:
        last = replace(more, current=more.current + shift)
        joined = {one.name: np.concatenate([getattr(at, one.name), getattr(last, one.name)]) for one in fields(at)}
        return {name: values[-n:] for name, values in bench.true(Conditions(**joined)).items()}

    ahead, back = read(_CURRENT_STEP_A), read(-_CURRENT_STEP_A)
    slope = {name: (ahead[name] - back[name]) / (2.0 * _CURRENT_STEP_A) for name in ahead}
    return read(0.0) | {"inductance_H": slope["flux_linkage_Wb"], "resistance_ohm": slope["voltage_V"]}


def _read_directly(
    bench: _Bench,
    found: Diagnosis,
    before: tuple[str, ...],
    right: Sequence[str],
    effect: str,
    calibration: Calibration,
) -> tuple[str, ...]:
    """The class after a direct reading, if it still holds the truth."""
    uncertainty = np.array(list(calibration.reads.values()))
    truth = _true_effects(bench, found, right)
    reading = direct_reading(effect, calibration, truth) + uncertainty * bench.rng.standard_normal(len(uncertainty))
    log = {}
    others = {one.name for one in found.missing} - set(before)
    for one in found.decision.left:
        own = set(one.names) - others
        if len(own) != 1 or len(one.names) != len(found.missing):
            continue
        spread = np.hypot(uncertainty, standard_errors(effect, calibration, one.fit.effects))
        missed = (reading - direct_reading(effect, calibration, one.fit.effects)) / spread
        log[own.pop()] = one.log_evidence - 0.5 * float(missed @ missed) - float(np.log(spread).sum())
    best = max(log.values())
    after = tuple(name for name in before if log.get(name, -np.inf) >= best + np.log(IN_CLASS))
    return after if says(after, right) else ()


def _true_effects(bench: _Bench, found: Diagnosis, right: Sequence[str]) -> tuple[AddedEffect, ...]:
    """The hidden error as the effect that it is called: fitted to what the campaign would read without noise."""
    at, campaign = bench.campaign.at, bench.campaign
    truth = bench.true(at)
    rows = {"run": at.run + 1, "order": 1 + np.arange(len(at.run)), "current_A": at.current, "distance_m": at.distance}
    rows |= {"coil_temperature_C": at.coil_C, "magnet_temperature_C": at.magnet_C}
    path = bench.place / "without_noise.csv"
    pd.DataFrame(rows | {name: truth[name] for name in campaign.meters}).to_csv(path, index=False)
    noise = "".join(f"{name} = {meter.sigma:.4g}\n" for name, meter in campaign.meters.items())
    path.with_suffix(".toml").write_text(noise, encoding="utf-8")
    known = {one.name for one in found.ranking if not one.note}
    names = [one for one in right if one in known][:1]
    return add_effects(bench.model, path, names, base="never").added


def advice_lines(followed: Sequence[Followed]) -> list[str]:
    """The counts, and what was missed."""
    advised = [one for one in followed if one.measurement]
    groups = {"all": advised} | {
        "a run": [o for o in advised if not o.direct],
        "direct": [o for o in advised if o.direct],
    }
    lines = [f"classes of several names with the truth: {len(followed)}; with advice: {len(advised)}"]
    for name, members in groups.items():
        share = Share(sum(one.followed for one in members), len(members))
        low, high = share.ci95
        lost, same = sum(not one.after for one in members), sum(len(one.after) >= len(one.before) for one in members)
        lines.append(
            f"{name}: smaller and holds the truth in {share.hits} of {share.of} (95 % between {100 * low:.0f} and "
            f"{100 * high:.0f} %); not smaller {same}, truth lost {lost}"
        )
    return lines + [
        f"  {one.number:04d} {', '.join(one.hidden)}: {', '.join(one.before)} -> {', '.join(one.after) or 'none'} "
        f"({one.verdict or 'no advice'}) {one.measurement}"
        for one in followed
        if not one.followed
    ]
