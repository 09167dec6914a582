"""What the offset voltage is taken to be: nothing, a zero reading (FFA1), the last plateau (FFA2).

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, section 3.
"""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from femfit.integrate.constants import SETTLING_S
from femfit.tables.coil_block import CoilBlock

BIN = 1e-3
"""Seconds over which a current is averaged before it tells a plateau: white noise of single samples grows with their
rate, and at 204.8 kS/s it would hide every plateau."""


@dataclass(frozen=True)
class Window:
    """Consecutive samples, summed up.

    Parameters
    ----------
    current_min, current_max : float
        Of the current's means over :data:`BIN`, A; infinite without a current.
    begin, end : float
        Times of the first and last sample, s.
    bin_sum, bin_samples : float, int
        Of the mean that is not complete yet, A and how many; at the window's end it is left out.
    """

    samples: int = 0
    voltage_sum: float = 0.0
    current_min: float = math.inf
    current_max: float = -math.inf
    begin: float = math.nan
    end: float = math.nan
    bin_sum: float = 0.0
    bin_samples: int = 0

    @property
    def voltage_mean(self) -> float:
        """Mean voltage, V."""
        return self.voltage_sum / self.samples

    def extended(self, block: CoilBlock, bin_size: int) -> "Window":
        """With more samples; the current is averaged over ``bin_size`` of them."""
        low, high, bin_sum, bin_samples = self.current_min, self.current_max, self.bin_sum, self.bin_samples
        if block.current is not None:
            starts = np.concatenate([[0], np.arange(bin_size - bin_samples, len(block), bin_size)])
            sums = np.add.reduceat(block.current, starts)
            counts = np.diff(starts, append=len(block))
            sums[0], counts[0] = sums[0] + bin_sum, counts[0] + bin_samples
            means = sums[counts == bin_size] / bin_size
            low, high = float(means.min(initial=low)), float(means.max(initial=high))
            full = counts[-1] == bin_size
            bin_sum, bin_samples = (0.0, 0) if full else (float(sums[-1]), int(counts[-1]))
        return Window(
            self.samples + len(block),
            self.voltage_sum + float(np.sum(block.voltage)),
            low,
            high,
            float(block.time[0]) if self.samples == 0 else self.begin,
            float(block.time[-1]),
            bin_sum,
            bin_samples,
        )


@dataclass(frozen=True)
class RuleState:
    """Of an offset rule after a window.

    Parameters
    ----------
    hold : bool
        Whether the field is held, because the record is still in its zero reading.
    still : float
        Seconds since the last ramp, or of the zero reading.
    """

    offset: float = 0.0
    hold: bool = False
    samples: int = 0
    still: float = 0.0
    level: float = math.nan


class OffsetRule(Protocol):
    """From windows to an offset voltage."""

    @property
    def window(self) -> float:
        """Length of a window in s."""
        ...

    def start(self) -> RuleState:
        """Before the first window."""
        ...

    def update(self, state: RuleState, window: Window) -> RuleState:
        """After a window; its offset holds from the next sample on."""
        ...


@dataclass(frozen=True)
class NoOffset:
    """The plain integral."""

    window: float = 1.0

    def start(self) -> RuleState:
        """No offset."""
        return RuleState()

    def update(self, state: RuleState, window: Window) -> RuleState:  # noqa: ARG002  # the protocol's
        """Nothing changes."""
        return state


@dataclass(frozen=True)
class ZeroReading:
    """FFA1: the mean over the record's beginning, where the excitation is off.

    Parameters
    ----------
    duration : float
        Of the zero reading, s; the field is held meanwhile.
    """

    duration: float
    window: float = 1.0

    def start(self) -> RuleState:
        """In the zero reading."""
        return RuleState(hold=self.duration > 0.0)

    def update(self, state: RuleState, window: Window) -> RuleState:
        """A longer mean, until the duration is over."""
        if not state.hold:
            return state
        total = state.samples + window.samples
        offset = (state.offset * state.samples + window.voltage_sum) / total
        still = state.still + self.window
        return replace(state, offset=offset, samples=total, still=still, hold=still < self.duration - 1e-9)


@dataclass(frozen=True)
class PlateauMean:
    """FFA2: the mean over the last second of a plateau, once the eddy currents of the ramp have decayed.

    Parameters
    ----------
    still_A : float
        A window whose current moves by less is on a plateau.
    still_V : float
        The same for the window's mean voltage, where the record has no current.
    """

    window: float = 1.0
    settling: float = SETTLING_S
    still_A: float = 0.1
    still_V: float = 1e-4

    def start(self) -> RuleState:
        """No ramp yet: the first still window counts."""
        return RuleState(still=math.inf)

    def update(self, state: RuleState, window: Window) -> RuleState:
        """A new mean, if the window lies on a settled plateau."""
        level = 0.5 * (window.current_min + window.current_max)
        if self._moves(state, window):
            return replace(state, still=0.0, level=level)
        if state.still < self.settling - 1e-9:
            return replace(state, still=state.still + self.window, level=level)
        return replace(state, offset=window.voltage_mean, still=state.still + self.window, level=level)

    def _moves(self, state: RuleState, window: Window) -> bool:
        if math.isinf(window.current_min):
            return abs(window.voltage_mean) > self.still_V
        moved = window.current_max - window.current_min
        if not math.isnan(state.level):
            # A wander too slow for one window shows against the window before.
            moved = max(moved, abs(0.5 * (window.current_min + window.current_max) - state.level))
        return moved > self.still_A
