"""The measurement that would refute a remainder: where it and nothing differ most, and nobody has measured yet."""

from dataclasses import dataclass

import numpy as np

from femfit.core.amount import amount, rounded
from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.identify.noise.whitening import NoiseModel
from femfit.identify.readings.observations import Observations
from femfit.identify.remainder.constants import LEVELS, UNMEASURED
from femfit.identify.series.balances import FORCE_BALANCE
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.tables.measurement import CHANNEL_WORDS

_READS = {FORCE_BALANCE: "force_N", "voltage_balance_V": "voltage_V"}


@dataclass(frozen=True)
class Refutation:
    """A reading that the remainder says to be another than the model's."""

    channel: str
    distance_m: float
    current_A: float
    velocity_m_s: float
    change: float  # With the remainder less without
    noise: float  # Standard deviation of one reading
    measured: bool  # Whether something was measured next to it

    def __str__(self) -> str:
        where = f"{amount(self.distance_m, 'm', 3)} and {amount(self.current_A, 'A')}"
        where += f" while the body moves at {amount(self.velocity_m_s, 'm/s')}" if self.velocity_m_s else ""
        again = " once more, on a new mount" if self.measured else ", where nothing was measured"
        return (
            f"To refute it, read the {CHANNEL_WORDS[self.channel]} at {where}{again}: with the remainder it is "
            f"{amount(abs(self.change), self.channel)} {'more' if self.change > 0 else 'less'} than without, "
            f"{rounded(abs(self.change) / self.noise, 2)} times the noise of one reading."
        )


def refutation(
    before: ActuatorModel, after: ActuatorModel, observations: Observations, noise: NoiseModel
) -> Refutation | None:
    """The reading at which the remainder says most over its noise; None where it changes no static reading."""
    table = observations.covariates
    measured = [table[name].to_numpy() for name in ("distance_m", "current_A")]
    ends = [(float(x.min()), float(x.max())) for x in measured]
    speed = table["velocity_m_s"].abs().max() if "velocity_m_s" in table else 0.0
    braked = any(added.effect.force is not None for added in after.effects[len(before.effects) :])
    d, i = (np.ravel(x) for x in np.meshgrid(*(np.linspace(*e, n) for e, n in zip(ends, LEVELS, strict=True))))
    velocity = float(speed) if braked else 0.0
    at = Conditions(observations.nominal, velocity_m_s=velocity)
    readings = [predict_readings(one, d, i, at) for one in (before, after)]
    far = _farness(d, i, measured, ends)
    best: tuple[float, Refutation] | None = None
    for name, sigma in noise.floor.items():
        read = _READS.get(name, name)
        if name not in noise.source or read not in readings[0]:
            continue
        change = readings[1][read] - readings[0][read]
        new = far > UNMEASURED
        score = np.abs(change) / sigma * np.where(new, 1.0, 0.5 if new.any() else 1.0)
        k = int(np.argmax(score))
        if score[k] > 0.0 and (best is None or score[k] > best[0]):
            values = (float(d[k]), float(i[k]), velocity, float(change[k]), sigma, not bool(new[k]))
            best = float(score[k]), Refutation(read, *values)
    return None if best is None else best[1]


def _farness(d: FloatArray, i: FloatArray, measured: list[FloatArray], ends: list[tuple[float, float]]) -> FloatArray:
    """Distance of settings from the nearest that was measured, over the ranges of the data."""
    spans = [max(high - low, 1e-300) for low, high in ends]
    seen = np.unique(np.round(np.stack([x / s for x, s in zip(measured, spans, strict=True)], axis=1), 3), axis=0)
    here = np.stack([d / spans[0], i / spans[1]], axis=1)
    return np.asarray([np.sqrt(np.min(np.sum((seen - one) ** 2, axis=1))) for one in here])
