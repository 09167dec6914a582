"""How a filter run ended: a name and a sentence that says what to do."""

from enum import IntEnum


class FilterOutcome(IntEnum):
    """State of one run; the first outcome other than RUNNING stays."""

    RUNNING = 0
    COVARIANCE_LOST = 1
    NOT_FINITE = 2
    LEFT_MODEL = 3
    INNOVATIONS_OUT_OF_BAND = 4

    @property
    def sentence(self) -> str:
        """What happened and what to do about it."""
        return _SENTENCES[self]


_SENTENCES = {
    FilterOutcome.RUNNING: "The filter runs.",
    FilterOutcome.COVARIANCE_LOST: (
        "The covariance is no longer positive definite. Use alpha = 1 or the square-root filter, double precision, "
        "and a process covariance that is positive definite."
    ),
    FilterOutcome.NOT_FINITE: (
        "A measurement, input or estimate is not a finite number. Check the sensor's samples and the initial state."
    ),
    FilterOutcome.LEFT_MODEL: (
        "The estimate went far outside of the distances and currents for which the model was fitted: the moving part "
        "is lost or the initial state is wrong. Start again from a measured distance."
    ),
    FilterOutcome.INNOVATIONS_OUT_OF_BAND: (
        "Most innovations stayed outside of their 99.9 % band: model, noise or sensor are not what the filter was "
        "told. Check the sensor's offset (4-state filter), the measurement noise and the force law."
    ),
}
