"""The fall of the error: how far a model was from the readings before something was added to it, and is after.

There is one definition, for every command, file, report and picture: per channel the root mean square of recorded minus
predicted over all readings that were used, in the channel's unit. No run's or mount's freedom is taken out of it.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import counted, weighed_amount
from femfit.identify.readings.observations import Observations
from femfit.tables.measurement import CHANNEL_WORDS


@dataclass(frozen=True)
class ChannelFall:
    """The error of one channel before and after."""

    channel: str
    readings: int
    # Root mean square of recorded minus predicted, in the channel's unit
    rms_before: float
    rms_after: float
    noise: float | None  # Standard deviation of one reading, from repeats or as declared; None where neither says it
    magnitude: float | None = None  # Of impedances: |Z| in the channel's unit at which all of them are given

    @property
    def before_over_noise(self) -> float | None:
        """The error before, in standard deviations of one reading."""
        return None if self.noise is None else self.rms_before / self.noise

    @property
    def after_over_noise(self) -> float | None:
        """The error after, in standard deviations of one reading."""
        return None if self.noise is None else self.rms_after / self.noise

    def amount(self, rms: float) -> str:
        """In the channel's unit, of an impedance as a share of its magnitude."""
        return weighed_amount(rms, self.channel, self.magnitude, 3)

    def __str__(self) -> str:
        before, after, count = (
            self.amount(self.rms_before),
            self.amount(self.rms_after),
            counted(self.readings, "reading"),
        )
        times = "" if self.noise is None else f"{self.after_over_noise:.3g} times the noise of one"
        if before == after:
            text = f"{CHANNEL_WORDS[self.channel]}: the error is unchanged, {after} rms in {count}"
            return f"{text}, {times}" if times else text
        change = "rises" if self.rms_after > self.rms_before else "falls"
        text = f"{CHANNEL_WORDS[self.channel]}: the error {change} from {before} to {after} rms in {count}"
        return f"{text}, from {self.before_over_noise:.3g} to {times}" if times else text


@dataclass(frozen=True)
class ErrorFall:
    """The fall of the error in every channel that was compared."""

    channels: tuple[ChannelFall, ...]

    def __str__(self) -> str:
        return "\n".join(str(one) for one in self.channels)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, channel by channel, with the errors over the noise."""
        return {
            one.channel: {
                **{key: value for key, value in asdict(one).items() if key not in {"channel", "magnitude"}},
                **({"magnitude": one.magnitude} if one.magnitude else {}),
                "before_over_noise": one.before_over_noise,
                "after_over_noise": one.after_over_noise,
            }
            for one in self.channels
        }


def error_fall(
    observations: Observations, before: FloatArray, after: FloatArray, noise: Mapping[str, float]
) -> ErrorFall:
    """The fall of the error between two predictions of the same readings, both of shape (M,) and in their units."""
    misfits = (observations.value - before, observations.value - after)
    rows = []
    for name in observations.channels:
        rms = [float(np.sqrt(np.mean(misfit[observations.of(name)] ** 2))) for misfit in misfits]
        count, magnitude = int(observations.of(name).sum()), observations.magnitude.get(name)
        rows.append(ChannelFall(name, count, rms[0], rms[1], noise.get(name), magnitude))
    return ErrorFall(tuple(rows))
