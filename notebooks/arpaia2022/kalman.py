"""The paper's Kalman filter: field from coil and a reference, one state, (5)-(13) and (14)-(16).

CS1 takes a Hall probe as the reference, CS2 the excitation current over the current-to-field ratio. A constant offset
voltage v_o leaves the field late by v_o tau / A, tau = T_s / K the filter's time constant: femfit's own filters estimate
the offset voltage as a second state, and this one reproduces the paper.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, sections 2.1 and 2.3 to 2.5. Printed D = 1/g of CS2 contradicts (16), where z
is a field already: D = 1.
"""

from dataclasses import dataclass, replace

import numpy as np

from arpaia2022.parallel_prefix import Folding, affine_recursion, riccati_recursion
from femfit.core.numerics import FloatArray
from femfit.core.errors import TableError
from femfit.integrate.integrator import Increments, LastSample, increments
from femfit.integrate.uncertainty import FieldBlock, Noise, Responses, SensingCoil
from femfit.tables.coil_record import CoilBlock

OFFSET_AVERAGE = 1.0
"""Seconds over which corrections are averaged (exponentially) to an offset voltage."""


@dataclass(frozen=True)
class KalmanState:
    """Of the filter after a sample.

    Parameters
    ----------
    field, variance : float
        x^+ and P^+; a field of NaN starts at the first reading of the reference.
    reference, forgotten, voltage_unit : float
        Sensitivities: see :class:`Responses`; forgotten is 1 minus that to a reference offset.
    """

    last: LastSample
    field: float
    variance: float
    offset: float = 0.0
    reference: float = 0.0
    forgotten: float = 1.0
    voltage_unit: float = 0.0


@dataclass(frozen=True)
class KalmanIntegrator:
    """CS1 (Hall probe) or CS2 (excitation current).

    Parameters
    ----------
    current_to_field : float or None
        g in A/T of (16); None takes the Hall probe, (13).
    initial_field : float
        B_0 in T; NaN takes the reference's first reading.
    """

    coil: SensingCoil
    noise: Noise
    sample_time: float
    current_to_field: float | None = None
    initial_field: float = float("nan")

    def start(self) -> KalmanState:
        """The state before the first sample: B_0 with its variance."""
        return KalmanState(LastSample(), self.initial_field, self.noise.initial_T**2)

    def reference(self, block: CoilBlock) -> FloatArray:
        """The second sensor's field in T, NaN where it has no reading."""
        if self.current_to_field is None:
            if block.hall is None:
                raise TableError("A filter with a Hall probe needs hall_T; instead received a record without it.")
            return block.hall
        if block.current is None:
            raise TableError("A filter with the current needs current_A; instead received a record without it.")
        return block.current / self.current_to_field

    def advance(self, state: KalmanState, block: CoilBlock) -> tuple[KalmanState, FieldBlock]:
        """Filter a block."""
        z = self.reference(block)
        last, steps = increments(state.last, block, self.coil, self.noise, self.sample_time)
        if np.isnan(state.field):  # all of it comes from the reference
            if not np.isfinite(z[0]):
                raise TableError("The paper's filter needs a reading of its reference at the first sample.")
            state = replace(state, field=float(z[0]), reference=float(z[0]), forgotten=0.0)
        return self._filter(state, last, steps, z, block.time)

    def _filter(
        self, state: KalmanState, last: LastSample, steps: Increments, z: FloatArray, time: FloatArray
    ) -> tuple[KalmanState, FieldBlock]:
        used = np.isfinite(z)
        readings = z if used.all() else np.where(used, z, 0.0)
        information = 1.0 / self.noise.reference.variance(readings)
        information[~used] = 0.0
        folding = Folding(len(z))
        variance, share = riccati_recursion(
            folding.fold(steps.variance, 0.0), folding.fold(information, 0.0), state.variance
        )
        pulled = (1.0 - share) * folding.fold(readings, 0.0)
        right = (
            share * folding.fold(steps.field, 0.0) + pulled,
            pulled,
            np.zeros_like(share),
            share * folding.fold(steps.dt / self.coil.area_m2, 0.0),
        )
        starts = (state.field, state.reference, state.forgotten, state.voltage_unit)
        results = [folding.unfold(x) for x in affine_recursion(share, right, starts)]
        posterior = folding.unfold(variance)
        x = results[0]
        before = np.concatenate([[state.field], x[:-1]])
        predicted = before + steps.field
        innovation = z - predicted
        offset = self._offset(state, steps.dt, predicted - x)
        prior = np.concatenate([[state.variance], posterior[:-1]]) + steps.variance
        spread = np.full(len(z), np.nan)
        np.divide(1.0, information, out=spread, where=used)
        block = FieldBlock(
            time,
            x,
            posterior,
            offset,
            innovation,
            spread + prior,
            self._responses(results),
        )
        ends = [float(values[-1]) for values in results]
        return KalmanState(last, ends[0], float(posterior[-1]), float(offset[-1]), *ends[1:]), block

    def _offset(self, state: KalmanState, dt: FloatArray, removed: FloatArray) -> FloatArray:
        """Corrections in T as the offset voltage that they undo, averaged over a second."""
        folding = Folding(len(dt))
        keep = np.exp(-dt / OFFSET_AVERAGE)
        rate = np.zeros_like(dt)
        np.divide(removed * self.coil.area_m2, dt, out=rate, where=dt > 0.0)
        rate *= 1.0 - keep
        return folding.unfold(affine_recursion(folding.fold(keep, 1.0), [folding.fold(rate, 0.0)], [state.offset])[0])

    def _responses(self, results: list[FloatArray]) -> Responses:
        x, reference, forgotten, voltage_unit = results
        known = 0.0 if np.isnan(self.initial_field) else self.initial_field
        coil = x - reference - forgotten * known
        return Responses(coil, reference, 1.0 - forgotten, voltage_unit)
