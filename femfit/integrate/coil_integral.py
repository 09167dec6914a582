"""What integrating a coil's voltage gave, as it is printed and as JSON."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from femfit.core.amount import counted
from femfit.core.finding import Finding
from femfit.core.printed import Printed
from femfit.integrate.methods import FEED_FORWARD, Method


@dataclass(frozen=True, eq=False, repr=False)
class CoilIntegral(Printed):
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

    record: str
    method: Method
    smoothed: bool
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
    field_model: Path | None
    rows: pd.DataFrame | None = field(repr=False, default=None)
    seconds: float = 0.0

    @property
    def expanded_uncertainty(self) -> float:
        """Coverage factor times standard uncertainty."""
        return self.coverage * self.standard_uncertainty

    def __str__(self) -> str:
        unit = self.quantity.rsplit("_", 1)[1]
        given = ", ".join(f"{name.replace('_', ' ')} {part:.3g}" for name, part in self.parts.items() if part > 0.0)
        # A plain integral has no reference, and a filter estimates the offset voltage.
        idle = ("reference_gain", "reference_offset") if self.method in FEED_FORWARD else ("offset_voltage",)
        none = [name.replace("_", " ") for name, part in self.parts.items() if part == 0.0 and name not in idle]
        how = f"{self.method}, smoothed" if self.smoothed else self.method
        told_by = "coil" if self.method in FEED_FORWARD else "reference"
        exact = f", if the {told_by}'s gain is exact" if self.parts[f"{told_by}_gain"] == 0.0 else ""
        if exact and any(finding.code == "gain" for finding in self.findings):
            exact += ", which the record makes doubtful"
        lines = [
            (
                f"{self.value:.9g} {unit} +- {self.expanded_uncertainty:.3g} {unit} (k = {self.coverage:g}) at "
                f"{self.end_s:.6g} s, the record's end{exact}"
            ),
            (
                f"{how}: {counted(self.samples, 'sample')}, {1.0 / self.sample_time_s:.6g} Hz, offset voltage "
                f"{1e6 * self.offset_V:.3g} uV at the end"
            ),
            f"standard uncertainty in {unit}: {given}" + (f"; nothing given for {', '.join(none)}" if none else ""),
            *(f"{finding.code}: {finding}" for finding in self.findings),
            *(f"written: {path}" for path in (self.field_model, self.output) if path is not None),
        ]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready, without the rows."""
        return {
            "record": self.record,
            "method": self.method,
            "smoothed": self.smoothed,
            "quantity": self.quantity,
            "samples": self.samples,
            "sample_time_s": self.sample_time_s,
            "end": {
                "time_s": self.end_s,
                "value": self.value,
                "standard_uncertainty": self.standard_uncertainty,
                "expanded_uncertainty": self.expanded_uncertainty,
                "coverage_factor": self.coverage,
                "parts": self.parts,
                "offset_V": self.offset_V,
            },
            "findings": [finding.as_dict() for finding in self.findings],
            "output": None if self.output is None else str(self.output),
            "seconds": self.seconds,
        }
