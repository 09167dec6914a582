"""The table ``[solver]``; as in :mod:`femfit.device.schema`."""

from typing import Annotated

from pydantic import Discriminator, Field, Tag

from femfit.device.schema import AXIS_KINDS, Entry, axis_kind

MAX_FREQUENCIES = 1000

Frequency = Annotated[float, Field(gt=0, le=1e9)]


class FrequencyRangeEntry(Entry):
    """``{ start = ..., stop = ..., per_decade = ... }``, both ends included."""

    start: Frequency = Field(description="Give the lowest frequency in Hz.")
    stop: Frequency = Field(description="Give the highest frequency in Hz; it belongs to the list.")
    per_decade: int = Field(ge=1, le=100, description="Give how many frequencies there are in each decade.")


FrequencyAxis = Annotated[
    Annotated[FrequencyRangeEntry, Tag(AXIS_KINDS[0])]
    | Annotated[list[Frequency], Field(min_length=1, max_length=MAX_FREQUENCIES), Tag(AXIS_KINDS[1])],
    Discriminator(
        axis_kind,
        custom_error_type="axis",
        custom_error_message="Input should be a list of frequencies or a table { start, stop, per_decade }",
    ),
]


class SolverEntry(Entry):
    """``[solver]``: how accurate the field solver has to be, and at which frequencies."""

    tolerance: float | None = Field(
        None, ge=1e-5, le=0.1, description="Give the relative accuracy of force and flux linkage, as 1e-3 for 0.1 %."
    )
    frequency_Hz: FrequencyAxis | None = Field(
        None,
        description="Give the frequencies of the impedance as an ascending list or as { start, stop, per_decade }.",
    )
    eddy_error: float = Field(
        0.01,
        ge=1e-4,
        le=0.2,
        description="Give the relative error of impedance, force and Hall field that the reduced model of the eddy "
        "currents has to meet.",
    )
    eddy_bias_A: float | list[float] | None = Field(
        None,
        description="Give the current in A about which the eddy currents of saturating parts are linearised, or a list "
        "with one for each circuit.",
    )
