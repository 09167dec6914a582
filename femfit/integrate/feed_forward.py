"""Plain integration, and integration of the voltage minus an estimated offset: trapezoid, FFA1, FFA2.

B_k = B_(k-1) + (T_s / A) ((v_k + v_(k-1)) / 2 - v_o). A rule says what v_o is: nothing (trapezoid), the mean over a
zero reading before the measurement (FFA1), or the mean over the last second in which the field stood still (FFA2).

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, (7) and section 3.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from femfit.integrate.field_block import FieldBlock
from femfit.integrate.increments import LastSample, increments
from femfit.integrate.offset_rules import BIN, OffsetRule, RuleState, Window
from femfit.integrate.uncertainty import Noise, Responses, SensingCoil
from femfit.tables.coil_block import CoilBlock


@dataclass(frozen=True)
class FeedForwardState:
    """Of a feed-forward integrator after a sample.

    Parameters
    ----------
    field, variance : float
        B in T and its accumulated noise variance.
    elapsed : float
        Integrated time in s.
    """

    last: LastSample
    field: float
    variance: float
    elapsed: float
    window: Window
    rule: RuleState


@dataclass(frozen=True)
class FeedForwardIntegrator:
    """Trapezoid, FFA1 or FFA2, by the rule that estimates the offset.

    Parameters
    ----------
    noise : Noise
        Of the samples; the reference is not used.
    initial_field, initial_sigma : float
        B_0 and its standard uncertainty in T.
    """

    coil: SensingCoil
    noise: Noise
    sample_time: float
    rule: OffsetRule
    initial_field: float = 0.0
    initial_sigma: float = 0.0

    def start(self) -> FeedForwardState:
        """The state before the first sample."""
        return FeedForwardState(
            LastSample(), self.initial_field, self.initial_sigma**2, 0.0, Window(), self.rule.start()
        )

    def advance(self, state: FeedForwardState, block: CoilBlock) -> tuple[FeedForwardState, FieldBlock]:
        """Integrate a block."""
        last, steps = increments(state.last, block, self.coil, self.noise, self.sample_time)
        step, variance, offset, integrated = steps.field.copy(), steps.variance.copy(), np.zeros(len(block)), steps.dt
        window, rule = state.window, state.rule
        live = np.ones(len(block))
        bin_size = min(max(1, round(BIN / self.sample_time)), self._window_samples())
        for part in self._parts(window, len(block)):
            offset[part] = rule.offset
            if rule.hold:
                step[part], variance[part], live[part] = 0.0, 0.0, 0.0
            step[part] -= live[part] * rule.offset * steps.dt[part] / self.coil.area_m2
            window = window.extended(block[part], bin_size)
            if window.samples == self._window_samples():
                rule, window = self.rule.update(rule, window), Window()
        field = state.field + np.cumsum(step)
        spread = state.variance + np.cumsum(variance)
        elapsed = state.elapsed + np.cumsum(live * integrated)
        nothing = np.full(len(block), np.nan)
        zero = np.zeros(len(block))
        responses = Responses(field - self.initial_field, zero, zero, elapsed / self.coil.area_m2)
        end = FeedForwardState(last, float(field[-1]), float(spread[-1]), float(elapsed[-1]), window, rule)
        return end, FieldBlock(block.time, field, spread, offset, nothing, nothing, responses)

    def _window_samples(self) -> int:
        return max(1, round(self.rule.window / self.sample_time))

    def _parts(self, window: Window, samples: int) -> Iterator[slice]:
        """The block cut where windows end."""
        begin, filled = 0, window.samples
        while begin < samples:
            end = min(samples, begin + self._window_samples() - filled)
            yield slice(begin, end)
            begin, filled = end, 0
