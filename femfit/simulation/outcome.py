"""How a closed loop ended: a name and a sentence; why, and what to do, is said by :mod:`femfit.simulation.why_lost`."""

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
        """What happened."""
        return _SENTENCES[self]


_SENTENCES = {
    LoopOutcome.HELD: "The body was held over the whole time.",
    LoopOutcome.PULLED_IN: "The body came closer than the model's shortest distance and hits the electromagnet.",
    LoopOutcome.FELL: "The body fell beyond the model's longest distance.",
    LoopOutcome.CURRENT_OUT_OF_RANGE: "The current left the range of the model, so that its force there is not known.",
    LoopOutcome.FILTER_DIVERGED: (
        "The filter diverged before anything else went wrong: its estimate left the model, was no number, or its "
        "innovations stayed out of their band."
    ),
}
