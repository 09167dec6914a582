"""What filters saw of a record."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, Printed
from femfit.core.text import amount, amount_range, counted
from femfit.estimate.consistency import Beside, Innovations
from femfit.estimate.constants import LEAST_JUDGED, MOST_LEFT, MOST_SEATINGS
from femfit.estimate.filter import Filter
from femfit.estimate.found_noise import FoundNoise
from femfit.estimate.process import FilterOutcome
from femfit.estimate.record_resistance import SteadyResistance
from femfit.estimate.run_filter import Replayed
from femfit.estimate.seating import Seating, not_followed
from femfit.model.actuator_model import ActuatorModel

UNUSED = "unused-column"


@dataclass(frozen=True, eq=False)
class OneFilter:
    """A record as one filter saw it."""

    name: str
    built: Filter
    replayed: Replayed
    innovations: tuple[Innovations, ...]
    beside: tuple[Beside, ...]
    estimates: Mapping[str, FloatArray]  # What the estimate says of each recorded channel
    lost_at_s: float | None
    outcome: FilterOutcome

    @property
    def trusted(self) -> bool:
        """Whether it ran through, and its innovations are as large as it says and white; not without any judged."""
        judged = self.innovations
        return self.lost_at_s is None and bool(judged) and all(sensor.consistent and sensor.white for sensor in judged)

    @property
    def misfit(self) -> float:
        """By how much the mean square of all normalised innovations exceeds 1; infinite where none is judged."""
        excess = sum(sensor.count * max(sensor.mean_square - 1.0, 0.0) for sensor in self.innovations)
        return excess / sum(sensor.count for sensor in self.innovations) if self.innovations else float("inf")

    @property
    def cautious(self) -> bool:
        """Whether it is not trusted only because it allows for more noise than the record has."""
        ran = self.lost_at_s is None and bool(self.innovations)
        return ran and not self.trusted and not any(sensor.bold for sensor in self.innovations)

    @property
    def sentence(self) -> str:
        """Whether it can be relied on."""
        settled = self.replayed.deviation[len(self.replayed.deviation) // 2 :, 0]
        certain = amount(float(np.nanmedian(settled)), "m") if np.isfinite(settled).any() else "unknown"
        if self.lost_at_s is not None:
            return f"{self.name}: lost at {amount(self.lost_at_s, 's', 4)}. {self._why_lost}"
        if self.trusted:
            return f"{self.name}: consistent. It claims the distance to {certain}."
        if not self.innovations:
            few = f"no sensor has {LEAST_JUDGED} readings"
            return f"{self.name}: not judged, because {few}. It claims the distance to {certain}."
        if self.cautious:
            return (
                f"{self.name}: too cautious: it allows for more noise than the record has. It claims the distance "
                f"to {certain}, an upper bound of its error."
            )
        return f"{self.name}: not consistent with its noise. It claims the distance to {certain}; do not rely on it."

    @property
    def _why_lost(self) -> str:
        """What the filter expected of the readings at which its covariance broke down, or how else it ended."""
        if self.outcome is not FilterOutcome.COVARIANCE_LOST:
            return self.outcome.sentence
        replayed = self.replayed
        row = int(np.flatnonzero(replayed.outcome != FilterOutcome.RUNNING)[0])
        rows = slice(max(0, row + 1 - LEAST_JUDGED), row + 1)
        ratio = np.nan_to_num(np.abs(replayed.innovation[rows]) / np.sqrt(replayed.variance[rows]))
        sample, k = np.unravel_index(int(ratio.argmax()), ratio.shape)
        name = self.built.process.outputs[k].name
        return (
            f"A reading of {name} was {ratio[sample, k]:.3g} of its expected deviations off the prediction "
            f"({amount(float(replayed.innovation[rows][sample, k]), self.built.process.outputs[k].unit)}), and the "
            "covariance did not survive it: the model is wrong by more than noise. Check the drawing, the sensor's "
            "characteristic and the columns' signs and units."
        )

    def lines(self) -> list[str]:
        """What became of it."""
        lines = [self.sentence]
        for sensor in self.innovations:
            band = f"{sensor.band.lower:.3g} to {sensor.band.upper:.3g}"
            worst = int(np.argmax(np.abs(sensor.autocorrelation)))
            white = "white" if sensor.white else f"not white ({sensor.autocorrelation[worst]:+.2f} at lag {worst + 1})"
            size = f"{amount(sensor.rms, sensor.unit)} rms, mean square {sensor.mean_square:.3g} (should be {band})"
            lines.append(f"  innovations of {sensor.sensor}: {size}, {white}")
        for channel in self.beside:
            unit = channel.column.rpartition("_")[2]
            what = "read by the filter" if channel.used else "not read by the filter: a check"
            late = ""
            if channel.delay_s is not None:
                when = "late" if channel.delay_s > 0.0 else "early"
                late = f", {amount(abs(channel.delay_s), 's')} {when}"
            lines.append(
                f"  {channel.column} beside the estimate ({what}): {amount(channel.rms, unit)} rms, mean "
                f"{amount(channel.mean, unit)}{late}"
            )
        return lines

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the series."""
        return {
            "name": self.name,
            "trusted": self.trusted,
            "cautious": self.cautious,
            "lost_at_s": self.lost_at_s,
            "states": list(self.built.process.names),
            "innovations": [
                {
                    "sensor": each.sensor,
                    "unit": each.unit,
                    "count": each.count,
                    "rms": each.rms,
                    "mean_square": each.mean_square,
                    "band": [each.band.lower, each.band.upper],
                    "autocorrelation": each.autocorrelation.tolist(),
                    "correlation_band": each.correlation_band,
                    "consistent": each.consistent,
                    "white": each.white,
                }
                for each in self.innovations
            ],
            "beside": [
                {"column": each.column, "used": each.used, "rms": each.rms, "mean": each.mean, "delay_s": each.delay_s}
                for each in self.beside
            ],
        }


@dataclass(frozen=True, eq=False, repr=False)
class Observation(Printed):
    """A recorded log as filters saw it.

    Examples
    --------
    >>> import femfit as ff
    >>> ff.close_loop("model.json", runs=1, seconds=0.5, rng=1).write_csv("log.csv")
    >>> seen = ff.observe("model.json", "log.csv", find=False)
    >>> seen.filters[0].trusted
    True
    """

    model: ActuatorModel
    source: str
    sensors: tuple[str, ...]
    time_s: FloatArray
    recorded: Mapping[str, FloatArray]
    filters: tuple[OneFilter, ...]
    findings: tuple[Finding, ...]
    noise: FoundNoise | None
    seatings: tuple[Seating, ...] = ()  # As the first filter tells them
    resistances: tuple[SteadyResistance, ...] = ()  # That steady currents show, whatever the filters do
    with_resistances: OneFilter | None = None  # The first filter with those that contradict, where it is not trusted

    @property
    def of_resistance(self) -> bool:
        """Whether the resistances that steady currents show account for most of the first filter's misfit."""
        mended = self.with_resistances
        if mended is None or mended.lost_at_s is not None:
            return False
        return mended.trusted or mended.misfit < MOST_LEFT * self.filters[0].misfit

    def __str__(self) -> str:
        first, *rivals = self.filters
        span = amount_range(float(self.time_s.min()), float(self.time_s.max()), "s", 3)
        count = counted(len(self.time_s), "sample")
        unused = [finding for finding in self.findings if finding.code == UNUSED]
        lines = first.lines()
        lines[1:1] = [
            *(f"check first: {finding}" for finding in self.findings if finding.severity != "info"),
            f"{self.source}: {count} from {span}, read through {', '.join(self.sensors)}",
            *(str(finding) for finding in unused),
        ]
        shown = [
            str(resistance)
            for resistance in self.resistances
            if self.with_resistances is not None and resistance.contradicts
        ]
        if self.with_resistances is not None and self.of_resistance:
            lost = f"lost at {amount(first.lost_at_s, 's', 4)}" if first.lost_at_s is not None else "not consistent"
            rest = "it is consistent" if self.with_resistances.trusted else "most of the misfit is gone, not all of it"
            lines[:1] = [*shown, f"{first.name}: {lost}; with this resistance {rest}."]
        else:
            lines[1:1] = shown
        followed = [seating for seating in self.seatings if seating.followed]
        lines += [str(seating) for seating in followed[:MOST_SEATINGS]]
        if len(followed) > MOST_SEATINGS:
            lines.append(f"... and {counted(len(followed) - MOST_SEATINGS, 'more arrival')} at a stop (--json)")
        if open_ := [seating for seating in self.seatings if not seating.followed]:
            lines.append(not_followed(open_))
        for rival in rivals:
            lines += rival.lines()
        if self.noise is not None and not self.of_resistance:
            lines += self.noise.lines(lost=first.lost_at_s is not None)
        notes = [str(finding) for finding in self.findings if finding.severity == "info" and finding not in unused]
        notes += [str(resistance) for resistance in self.resistances if str(resistance) not in shown]
        return "\n".join([*lines, *(f"note: {note}" for note in notes)])

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

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON-ready data, without the series."""
        return {
            "source": self.source,
            "samples": len(self.time_s),
            "sensors": list(self.sensors),
            "filters": [run.to_dict() for run in self.filters],
            "seatings": [vars(seating) for seating in self.seatings],
            "noise": None if self.noise is None else self.noise.to_dict(),
            "resistances": [
                {**vars(resistance), "contradicts": resistance.contradicts} for resistance in self.resistances
            ],
            "of_resistance": self.of_resistance,
            "findings": [str(finding) for finding in self.findings],
        }
