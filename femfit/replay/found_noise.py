"""The noises that a record shows, in plain words, and a model that has them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femfit.core.amount import amount
from femfit.model.actuator_model import ActuatorModel
from femfit.model.process_noise import ProcessNoise
from femfit.model.sensors import HALL, reading_of
from femfit.replay.friction import DryFriction


@dataclass(frozen=True)
class NoiseEstimate:
    """A standard deviation or density from a record."""

    name: str  # acceleration, voltage, or a sensor's
    unit: str
    value: float
    assumed: float  # What the filter was given
    low: float  # 95 % interval
    high: float
    known: bool  # False where the record only says that it is no larger than ``high``

    @property
    def tells(self) -> bool:
        """Whether the record says more than that the noise may be larger than the filter was given."""
        return self.known or self.high < self.assumed

    @property
    def interval(self) -> str:
        """Value and interval, or the largest that it may be."""
        if not self.known:
            return f"at most {amount(self.high, self.unit)}"
        low, high = amount(self.low, self.unit, 3), amount(self.high, self.unit, 3)
        return f"{amount(self.value, self.unit, 3)} ({low} to {high})"


@dataclass(frozen=True, eq=False)
class FoundNoise:
    """All noises of a record."""

    estimates: tuple[NoiseEstimate, ...]
    samples: int
    force_N: float | None  # Force error that the acceleration noise amounts to
    shares: dict[str, dict[str, float]]  # Of each sensor's innovations' variance, by what makes it
    # The same noises by least squares on the autocovariances of the innovations
    by_autocovariance: tuple[NoiseEstimate, ...] = ()
    friction: DryFriction | None = None  # That the model does not know, where the record shows one

    def lines(self, *, lost: bool = False) -> list[str]:
        """In plain words; a noise that may be larger than the filter was given is not told where it is not known.

        Parameters
        ----------
        lost : bool
            Whether the filter was lost: then what the innovations are made of cannot be told.
        """
        lines = [f"noise that the record shows ({self.samples} samples):"]
        if lost:
            lines[0] = (
                f"noise that would explain {self.samples} samples if the model were right, which lost the record:"
            )
        for estimate in self.estimates:
            if not estimate.tells:
                continue
            was = f"the filter was given {amount(estimate.assumed, estimate.unit)}"
            if estimate.name == "acceleration":
                what = "force that the model does not know"
                was += (
                    f"; it amounts to {amount(self.force_N, 'N')}"
                    if self.force_N is not None and estimate.known
                    else ""
                )
            else:
                what = (
                    "voltage that the driver does not tell"
                    if estimate.name == "voltage"
                    else f"noise of sensor {estimate.name}"
                )
            lines.append(f"  {what}: {estimate.interval}; {was}")
            lines += [
                f"    by autocovariance: {second.interval}"
                for second in self.by_autocovariance
                if second.name == estimate.name and second.tells
            ]
        if self._disagree:
            lines.append(
                "  The two methods disagree: the model is wrong by more than noise, or the filter was given noises far "
                "off. Write these into a model (--write-noise) and run the record again."
            )
        if self.friction is not None:
            share = min(1.0, (self.friction.force_N / self.force_N) ** 2) if self.force_N else 1.0
            lines.append(f"  {100.0 * share:.0f} % of that force is friction: {self.friction}")
        for sensor, parts in () if lost else self.shares.items():
            shown = ", ".join(f"{100.0 * share:.0f} % {name}" for name, share in parts.items() if share >= 0.005)
            lines.append(f"  the innovations of {sensor} are {shown}")
        return lines

    @property
    def _disagree(self) -> bool:
        """Whether an interval of one method lies wholly outside of the other's."""
        pairs = [
            (first, second)
            for first in self.estimates
            for second in self.by_autocovariance
            if first.name == second.name
        ]
        return any(first.low > second.high or (first.known and second.low > first.high) for first, second in pairs)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return {
            "estimates": [vars(estimate) for estimate in self.estimates],
            "by_autocovariance": [vars(estimate) for estimate in self.by_autocovariance],
            "friction": self.friction and vars(self.friction),
            "samples": self.samples,
            "shares": self.shares,
        }


def with_noise(model: ActuatorModel, noise: FoundNoise) -> ActuatorModel:
    """The model with the noises that a record showed; what the record could not tell stays."""
    deviations = {estimate.name: estimate.value for estimate in noise.estimates if estimate.known}
    process = ProcessNoise(
        deviations["acceleration"] ** 2 if "acceleration" in deviations else None, deviations.get("voltage")
    )

    def changed(quiet: ActuatorModel) -> ActuatorModel:
        def own(name: str, before: float) -> float:  # what is left of the noise beside the converter's rounding
            rounding = reading_of(quiet, name).white ** 2 - before**2
            return float(np.sqrt(max(deviations[name] ** 2 - rounding, 0.0))) if name in deviations else before

        sensors = tuple(replace(s, noise=own(s.name, s.noise)) for s in quiet.other_sensors)
        hall = quiet.sensor and replace(quiet.sensor, noise_V=own(HALL, quiet.sensor.noise_V))
        return replace(quiet, other_sensors=sensors, sensor=hall, process_noise=process)

    held = changed(model)
    return held if model.base is None else replace(held, base=changed(model.base))
