"""How a closed loop ended: a name and a sentence that says what to do."""

from enum import IntEnum


class LoopOutcome(IntEnum):
    """End of one run; the first outcome other than HELD stays."""

    HELD = 0
    PULLED_IN = 1
    FELL = 2
    CURRENT_OUT_OF_RANGE = 3
    FILTER_DIVERGED = 4

    @property
    def sentence(self) -> str:
        """What happened and what to do about it."""
        return _SENTENCES[self]


_SENTENCES = {
    LoopOutcome.HELD: "The body was held over the whole time.",
    LoopOutcome.PULLED_IN: (
        "The body is lost: it came closer than the model's shortest distance and hits the electromagnet. It takes a "
        "filter instead of the direct measurement, less sensor noise, a truer force law or a larger reference distance."
    ),
    LoopOutcome.FELL: (
        "The body is lost: it fell beyond the model's longest distance. It takes a filter instead of the direct "
        "measurement, less sensor noise, a truer force law, a smaller reference distance or a higher supply voltage."
    ),
    LoopOutcome.CURRENT_OUT_OF_RANGE: (
        "The current left the range of the model, so its force there is not known. Narrow the driver's clamp or sweep "
        "and fit a wider range of currents."
    ),
    LoopOutcome.FILTER_DIVERGED: (
        "The filter diverged before anything else went wrong: its estimate left the model, was no number, or its "
        "innovations stayed out of their band. Check the sensor's offset (4-state filter), the noise and the force law."
    ),
}
