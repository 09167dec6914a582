"""What adding effects to a model says: the new model, the effects' sizes, and how far the error fell."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.finding import Finding
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnosis import Gate
from femfit.model.actuator_model import ActuatorModel


@dataclass(frozen=True)
class Step:
    """One bar of the waterfall.

    Parameters
    ----------
    text : str
        What was added in this step.
    unseen : mapping of str to float
        Rms per channel on runs left out, with this and everything before it.
    """

    text: str
    unseen: Mapping[str, float]


@dataclass(frozen=True)
class EffectSize:
    """What an added effect changes of one channel, where it changes it most within the data.

    Parameters
    ----------
    of_largest : float
        ``change`` over the largest magnitude that the base predicts for this channel.
    """

    effect: str
    channel: str
    change: float
    ci95: tuple[float, float]
    of_largest: float
    distance_m: float
    current_A: float


@dataclass(frozen=True, eq=False)
class AddResult:
    """Effects added to a model.

    All errors are root mean squares per channel beside each run's own re-mount and offset, except ``as_read``.

    Parameters
    ----------
    model : ActuatorModel
        With the effects, ready to be written.
    added : tuple of AddedEffect
        The effects that were fitted, in order, with 95 % intervals.
    base : tuple of AddedEffect
        Amplitudes of the base that were fitted beside them; none where they did not help on runs left out.
    kept : tuple of str
        Effects that the model had before and that these data cannot refit.
    before, after : mapping of str to float
        On the runs that were fitted.
    unseen_before, unseen_after : mapping of str to float
        On runs left out, each in turn.
    as_read : mapping of str to mapping of str to float
        ``before``, ``after`` and ``floor`` on runs left out with the re-mounts and run offsets in them.
    steps : tuple of Step
        From the model as it was to the last effect.
    suspicious : tuple of str
        What is unusual of the fitted parameters, one plain sentence each.
    findings : tuple of str
        What else should be known, one plain sentence each.
    """

    model: ActuatorModel
    added: tuple[AddedEffect, ...]
    base: tuple[AddedEffect, ...]
    kept: tuple[str, ...]
    before: Mapping[str, float]
    after: Mapping[str, float]
    unseen_before: Mapping[str, float]
    unseen_after: Mapping[str, float]
    floor: Mapping[str, float]
    floor_source: Mapping[str, str]
    as_read: Mapping[str, Mapping[str, float]]
    steps: tuple[Step, ...]
    sizes: tuple[EffectSize, ...]
    suspicious: tuple[str, ...]
    gate_before: Gate
    gate_after: Gate
    readings: int
    runs: int
    findings: tuple[Finding, ...] = ()

    @property
    def unseen_ratio(self) -> float:
        """Root mean square over the channels of the error on runs left out over the noise floor."""
        ratios = [self.unseen_after[name] / self.floor[name] for name in self.floor]
        return float(np.sqrt(np.mean(np.square(ratios))))

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the model."""
        names = ("kept", "before", "after", "unseen_before", "unseen_after", "floor", "floor_source", "as_read")
        return {
            "added": [_effect(one) for one in self.added],
            "base": [_effect(one) for one in self.base],
            **{name: getattr(self, name) for name in names},
            "unseen_ratio": self.unseen_ratio,
            "steps": [vars(step) for step in self.steps],
            "sizes": [vars(size) for size in self.sizes],
            "suspicious": list(self.suspicious),
            "gate_before": vars(self.gate_before),
            "gate_after": vars(self.gate_after),
            "readings": self.readings,
            "runs": self.runs,
            "coil_temperature_C": self.model.coil_temperature_C,
            "magnet_temperature_C": self.model.magnet_temperature_C,
            "findings": [finding.as_dict() for finding in self.findings],
        }


def _effect(added: AddedEffect) -> dict[str, Any]:
    return {
        "name": added.effect.name,
        "parameters": dict(added.parameters),
        "ci95": {name: list(interval) for name, interval in added.ci95.items()},
    }
