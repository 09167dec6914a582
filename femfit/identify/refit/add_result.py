"""What adding effects to a model says: the new model, the effects' sizes, and how far the error fell."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from femfit.core.results import Finding, Printed
from femfit.core.text import probability
from femfit.effects.effect import AddedEffect
from femfit.effects.words import describe, titled, titles_of
from femfit.identify.comparison.fall import ErrorFall
from femfit.identify.comparison.lack_of_fit import LackOfFit
from femfit.identify.constants import HARMS, LEVEL_AFTER
from femfit.identify.noise.scatter import in_words
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.place import notes, suspicions
from femfit.identify.refit.filter_fall import FilterFall
from femfit.identify.refit.sizes import EffectSize
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import CHANNEL_WORDS


@dataclass(frozen=True)
class Step:
    """One bar of the waterfall: what was added, and the error per channel with it and everything before it."""

    text: str
    rms: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class AddResult(Printed):
    """Effects added to a model; printed, it is what ``femfit add`` prints.

    Parameters
    ----------
    model : ActuatorModel
        With the effects, ready to be written.
    added : tuple of AddedEffect
        The effects that were fitted, in order, with 95 % intervals.
    base : tuple of AddedEffect
        Tolerances of the drawing that were fitted beside them; none where they did not help on runs left out.
    kept : tuple of str
        Effects that the model had before and that these data cannot refit.
    fall : ErrorFall
        Error before and after, over all readings.
    left_out : mapping of str to float
        Root mean square per channel on readings that were not fitted: each run in turn, or quarters of a single run.
    floor : mapping of str to float
        Standard deviation of one reading, in the channels in which it is known.
    steps : tuple of Step
        From the model as it was to the last effect.
    suspicious : tuple of str
        What is unusual of the fitted parameters, one sentence each.
    better_alone : str
        A tolerance that was fitted beside the effects and explains more by itself than they do, in words; else empty.
    observations : Observations
        The readings beside the model without what was refitted.
    beyond_noise : mapping of str to float
        Channels whose error after is more than 1.2 times what declared noise, or repeats, show, in times the noise.
    filter : FilterFall or None
        What it does to the filter on runs of a record that were left out; None of a bench table.

    Examples
    --------
    >>> import femfit as ff
    >>> better = ff.add_effects(ff.read_model("model.json"), "bench.csv", "core_saturation", base="never")
    >>> force = better.fall.channels[0]
    >>> force.rms_after < force.rms_before
    True
    """

    model: ActuatorModel
    added: tuple[AddedEffect, ...]
    base: tuple[AddedEffect, ...]
    kept: tuple[str, ...]
    fall: ErrorFall
    left_out: Mapping[str, float]
    floor: Mapping[str, float]
    floor_source: Mapping[str, str]
    steps: tuple[Step, ...]
    sizes: tuple[EffectSize, ...]
    suspicious: tuple[str, ...]
    lack_of_fit_before: LackOfFit
    lack_of_fit_after: LackOfFit
    readings: int
    runs: int
    observations: Observations
    findings: tuple[Finding, ...] = ()
    better_alone: str = ""
    beyond_noise: Mapping[str, float] = field(default_factory=dict)
    filter: FilterFall | None = None

    @property
    def accepted(self) -> bool:
        """Whether the effects help on runs left out: the error falls somewhere, and no filter there is worse."""
        helps = any(HARMS * self.left_out[one.channel] < one.rms_before for one in self.fall.channels)
        return (helps or not self._risen()) and (self.filter is None or self.filter.accepted)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the model."""
        names = ("kept", "left_out", "floor", "floor_source", "readings", "runs")
        return {
            "added": [_effect(one) for one in self.added],
            "base": [_effect(one) for one in self.base],
            **{name: getattr(self, name) for name in names},
            "error_fall": self.fall.to_dict(),
            "steps": [vars(step) for step in self.steps],
            "sizes": [vars(size) for size in self.sizes],
            "suspicious": list(self.suspicious),
            "lack_of_fit_before": vars(self.lack_of_fit_before),
            "lack_of_fit_after": vars(self.lack_of_fit_after),
            "coil_temperature_C": self.model.coil_temperature_C,
            "magnet_temperature_C": self.model.magnet_temperature_C,
            "findings": [one.as_dict() for one in self.findings],
            "accepted": self.accepted,
            "beyond_noise": dict(self.beyond_noise),
            "filter": self.filter and self.filter.to_dict(),
        }

    def __str__(self) -> str:
        lines = [*suspicions(self.findings), self._verdict()]
        lines += [] if self.filter is None else [str(self.filter)]
        for added in self.added:
            words = describe(added, self.observations.nominal) or [added.effect.symptom.rstrip(".")]
            lines.append(f"  {added.effect.name}: {'; '.join(words)}.")
            lines += [f"    {size}" for size in self.sizes if size.effect == added.effect.name]
        lines += str(self.fall).split("\n")
        lines += [self._left_out(), *self._circumstances()]
        lines += [f"suspicious: {sentence}" for sentence in self.suspicious]
        text = "\n".join([*lines, *notes(self.findings)])
        return titled(text, titles_of(self.observations.nominal.drawn))

    def _verdict(self) -> str:
        names, after = " and ".join(added.effect.name for added in self.added), self.lack_of_fit_after
        left = in_words(
            self.observations, self.beyond_noise, {one.channel: one.rms_after for one in self.fall.channels}
        )
        if after.p_value > LEVEL_AFTER:
            tests = f"({probability(after.p_value)}; before, {probability(self.lack_of_fit_before.p_value)})"
            rest = f"what is left is noise {tests}."
            if left:
                missed = " and ".join(left.values())
                rest = f"the test finds nothing in what is left {tests}, but the model misses {missed}."
        else:
            rest = f"the misfit that is left is not noise ({probability(after.p_value)})."
        doubt = " Its size is not certain: see below." if self.suspicious else ""
        if self.better_alone:
            names += f", but a tolerance of the drawing explains more than it by itself ({self.better_alone})"
        risen = f"the error on runs left out rises in {self._risen()}" if self._risen() else ""
        if not self.accepted:
            worse = risen if self.filter is None or self.filter.accepted else "the filter is worse on runs left out"
            return f"Not accepted: with {names} {worse}.\nOn the readings fitted, {rest}"
        return (
            f"Added {names}, although {risen}.\nOn the readings fitted, {rest}{doubt}"
            if risen
            else (f"Added {names}: {rest}{doubt}")
        )

    def _risen(self) -> str:
        """The channels whose error on runs left out is larger than before, in words."""
        return " and ".join(
            CHANNEL_WORDS[one.channel]
            for one in self.fall.channels
            if self.left_out[one.channel] > HARMS * one.rms_before
        )

    def _left_out(self) -> str:
        errors = ", ".join(
            f"{CHANNEL_WORDS[one.channel]} {one.amount(self.left_out[one.channel])}" for one in self.fall.channels
        )
        part = f"each of the {self.runs} runs" if self.runs > 1 else "each quarter of the one run"
        return f"Fitted without {part} in turn, the error there is {errors} rms."

    def _circumstances(self) -> list[str]:
        lines = []
        if self.base:
            words = [clause for one in self.base for clause in describe(one, self.observations.nominal)]
            lines.append(f"Fitted beside it, each known to 2 % (one standard deviation): {'; '.join(words)}.")
        if self.kept:
            lines.append(f"Kept as they were, since these data cannot refit them: {', '.join(self.kept)}.")
        if any(added.effect.circuit or "temperature" in " ".join(added.effect.needs) for added in self.added):
            lines.append(
                f"Plant and filters run with the coil at {self.model.coil_temperature_C:g} °C"
                f"{self._warmer('coil_temperature')} and the magnet at {self.model.magnet_temperature_C:g} °C"
                f"{self._warmer('magnet_temperature')}."
            )
        return lines

    def _warmer(self, name: str) -> str:
        """What was found beside a temperature that was not recorded; plant and filters run with it too."""
        kelvin = sum(
            a.parameters.get("warmer_K", 0.0) + a.parameters.get("warming_K", 0.0)
            for a in self.added
            if a.effect.name == name
        )
        return f" and the {kelvin:.3g} K more that were found" if kelvin else ""


def _effect(added: AddedEffect) -> dict[str, Any]:
    return {
        "name": added.effect.name,
        "parameters": dict(added.parameters),
        "ci95": {name: list(interval) for name, interval in added.ci95.items()},
    }
