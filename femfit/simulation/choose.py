"""Which controller a loop has where none is asked for: the one whose linear loop is farthest from instability.

Every controller is designed, since that takes seconds. Of those that are stable
with their filter, delays and drivers the one with the largest margins at its worst point of rest is taken, cut where
noise takes too much of the commands' room.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees

from femfit.core.errors import DomainError, FilterError
from femfit.simulation.constants import NOISE_ROOM
from femfit.simulation.design import CONTROLLERS, ControllerName, LoopDesign, ObserverName
from femfit.simulation.margins import Margins, worst_of


@dataclass(frozen=True)
class Choice:
    """The controller taken and the margins of all that were designed, the best first."""

    observer: ObserverName
    margins: Mapping[ControllerName, Margins]

    @property
    def controller(self) -> ControllerName:
        """The one that is taken."""
        return next(iter(self.margins))

    def text(self, lost: Sequence[str] = ()) -> str:
        """A line for the first controller that is not among those with which runs were lost."""
        taken = next(name for name in self.margins if name not in lost)
        first, *rivals = [_standing(name, margins) for name, margins in self.margins.items()]
        why = (
            "its linear loop keeps the largest margins of phase and modulus"
            if self.margins[taken].stable
            else "it grows least"
        )
        if lost:
            why = f"runs are lost with {' and '.join(lost)}, whose linear loop keeps larger margins"
        return f"{taken} is chosen on {self.observer}, as {why}: {', '.join((first, *rivals))}"


def choose(design: LoopDesign, observer: ObserverName) -> Choice:
    """Design all controllers and order them.

    Raises
    ------
    DomainError
        If no controller can be designed at all.
    """
    margins: dict[ControllerName, Margins] = {}
    reasons = []
    for name in CONTROLLERS:
        try:
            margins[name] = worst_of(design.margins(name, observer))
        except (DomainError, FilterError) as error:
            reasons.append(str(error))
    if not margins:
        raise DomainError(" ".join(dict.fromkeys(reasons)))
    return Choice(observer, dict(sorted(margins.items(), key=lambda item: _rank(item[1]), reverse=True)))


def _rank(margins: Margins) -> tuple[bool, float, float, float]:
    """Stable before unstable; then the margins, or the slower growth."""
    return margins.stable, margins.kept, margins.modulus, margins.slowest_pole_rad_s


def _standing(name: str, margins: Margins) -> str:
    if not margins.stable:
        return f"{name} unstable, growing by {-margins.slowest_pole_rad_s:.3g} 1/s"
    noisy = f" with noise of {100.0 * margins.noise_share:.2g} %" if margins.noise_share > NOISE_ROOM else ""
    return f"{name} {degrees(margins.phase_rad):.2g} degrees and {margins.modulus:.2g}{noisy}"
