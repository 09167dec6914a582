"""The methods by name, the noise of their record (type A of the GUM, 4.2), and the result as it is printed."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.results import Finding, Result, attributes
from femfit.integrate.feed_forward import SETTLING_S, STILL_A, PlateauIntegrator, ZeroReadingIntegrator
from femfit.integrate.field_of_current import FieldModel, precycled
from femfit.integrate.integrator import Integrator
from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.record_watch import sentence
from femfit.integrate.uncertainty import FieldBlock, LinearSigma, Noise, SensingCoil, white_sigma
from femfit.tables.coil_record import CoilBlock

Method = Literal["trapezoid", "ffa1", "ffa2", "cs1-offset", "cs2", "cs2-identified"]

FEED_FORWARD = ("trapezoid", "ffa1", "ffa2")
FILTERS = ("cs1-offset", "cs2", "cs2-identified")

FIRST_FIELD_SIGMA_T = 3e-3
"""Uncertainty of the first field where a current is the reference. Chosen: the remanence of a core that was switched
off."""


@dataclass(frozen=True)
class IntegrationOptions:
    """What a method is given besides the record.

    No initial field in T is 0 for feed-forward methods, and the reference's first reading for filters. No
    ``reference_sigma`` of the field model, beside the current's own noise, is its rms. No noise evaluates it from the
    record's first block.
    """

    method: Method
    coil: SensingCoil
    initial_field: float | None = None
    zero_reading: float | None = None
    settling: float = SETTLING_S
    still_A: float = STILL_A
    field_model: FieldModel | None = None
    reference_sigma: LinearSigma | None = None
    noise: Noise | None = None


def make_integrator(options: IntegrationOptions, first: CoilBlock) -> Integrator:
    """The integrator of a method, for a record that begins with a block."""
    if len(first) < 3:
        raise TableError(f"A record needs at least 3 samples; instead received {len(first)}.")
    record = options.coil, options.noise or record_noise(options, first), float(np.median(np.diff(first.time)))
    initial = options.initial_field
    if options.method in FILTERS:
        return OffsetFilter(*record, math.nan if initial is None else initial, field_model=options.field_model)
    if options.method == "ffa2":
        return PlateauIntegrator(*record, initial or 0.0, settling=options.settling, still_A=options.still_A)
    if options.method == "trapezoid":
        return Integrator(*record, initial or 0.0)
    if options.zero_reading is None:
        raise TableError(
            "ffa1 takes the offset voltage from the record's begin, while nothing moves: give its length with "
            "--zero-reading-s."
        )
    return ZeroReadingIntegrator(*record, initial or 0.0, zero_reading=options.zero_reading)


def record_noise(options: IntegrationOptions, first: CoilBlock) -> Noise:
    """White noise of the samples as the record's first block shows it, and a field model's own error."""
    voltage = LinearSigma(white_sigma(first.voltage))
    if options.method in FEED_FORWARD:
        return Noise(voltage, LinearSigma(0.0), 0.0)
    if options.field_model is None:
        if first.hall is None:
            raise TableError(f"{options.method} needs hall_T; instead received a record without it.")
        hall = white_sigma(first.hall)
        return Noise(voltage, LinearSigma(hall), max(10.0 * hall, 1e-3))
    error = LinearSigma(options.field_model.rms_T)
    if options.reference_sigma is not None:
        if first.current is None:
            raise TableError(f"{options.method} needs current_A; instead received a record without it.")
        _, field = options.field_model.advance(precycled(options.field_model.terms), first.time, first.current)
        error = LinearSigma(max(options.reference_sigma.floor, white_sigma(field)), options.reference_sigma.relative)
    return Noise(voltage, error, max(FIRST_FIELD_SIGMA_T, 3.0 * error.floor))


def integrate_blocks(integrator: Integrator, blocks: Iterable[CoilBlock]) -> Iterator[tuple[CoilBlock, FieldBlock]]:
    """Stream a record through an integrator."""
    state = integrator.start()
    for block in blocks:
        state, out = integrator.advance(state, block)
        yield block, out


@dataclass(frozen=True, eq=False, repr=False)
class CoilIntegral(Result):
    """What integrating a coil's voltage gave.

    Parameters
    ----------
    quantity : str
        ``field_T``, or ``flux_linkage_Wb`` without a coil area.
    value, standard_uncertainty : float
        At the record's end, in the quantity's unit.
    parts : dict
        Standard uncertainty at the end by source.
    offset_V : float
        Offset voltage that was taken off at the end.
    rows : DataFrame or None
        The record's columns with the quantity, its standard uncertainty and the offset; None where they were written.

    Examples
    --------
    >>> import femfit as ff
    >>> integral = ff.integrate_coil("record.csv", coil_area_m2=0.05)
    >>> round(1e6 * integral.offset_V), list(integral.rows)[-1]
    (10, 'offset_V')
    """

    data = "record", "method", "quantity", "samples", "sample_time_s", "end", "findings", "output", "seconds"

    record: str
    method: Method
    quantity: str
    samples: int
    sample_time_s: float
    end_s: float
    value: float
    standard_uncertainty: float
    coverage: float
    parts: dict[str, float]
    offset_V: float
    findings: tuple[Finding, ...]
    output: Path | None
    rows: pd.DataFrame | None = field(repr=False, default=None)
    seconds: float = 0.0

    @property
    def expanded_uncertainty(self) -> float:
        """Coverage factor times standard uncertainty."""
        return self.coverage * self.standard_uncertainty

    @property
    def refuted_by(self) -> tuple[str, ...]:
        """Codes of the findings beside which neither the value at the end nor its uncertainty can be believed.

        A feed-forward method hangs on the coil alone. A filter mixes it with its reference: where their gains
        contradict each other, it is wrong whichever of them is exact.
        """
        spoiled = {"sign", "clipped", "innovations"}
        if self.method in FILTERS:
            spoiled |= {"gain"}
        if self.method == "cs1-offset":
            spoiled |= {"stuck"}
        return tuple(finding.code for finding in self.findings if finding.code in spoiled)

    def __str__(self) -> str:
        return sentence("integral", "coil", self, "coil" if self.method in FEED_FORWARD else "reference")

    @property
    def end(self) -> dict[str, Any]:
        """The quantity at the record's end."""
        uncertainty = "standard_uncertainty", "expanded_uncertainty", "coverage_factor=coverage"
        return attributes(self, "time_s=end_s", "value", *uncertainty, "parts", "offset_V", "refuted_by")
