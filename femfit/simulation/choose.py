"""Which controller a loop has where none is asked for: the one whose linear loop is farthest from instability.

Every controller is designed, since that takes seconds, and none is simulated for the choice. Of those that are stable
with their filter, delays and drivers, and whose noise leaves the commands their room, the one with the largest modulus
margin at its worst point of rest is taken.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from femfit.core.errors import DomainError, FilterError
from femfit.simulation.constants import NOISE_FILLS
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

    def __str__(self) -> str:
        first, *others = [_standing(name, margins) for name, margins in self.margins.items()]
        found = next(iter(self.margins.values()))
        why = "its linear loop keeps the largest modulus margin" if sound(found) else "it comes nearest to a sound loop"
        beside = f"; {', '.join(others)}" if others else ""
        return f"{self.controller} is chosen, as {why} on {self.observer}: {first}{beside}"


def choose(design: LoopDesign, observer: ObserverName) -> Choice:
    """Design all controllers and order them.

    Raises
    ------
    DomainError
        If no controller can be designed at all.
    """
    found: dict[ControllerName, Margins] = {}
    reasons = []
    for name in CONTROLLERS:
        try:
            found[name] = worst_of(design.margins(name, observer))
        except (DomainError, FilterError) as error:
            reasons.append(str(error))
    if not found:
        raise DomainError(" ".join(dict.fromkeys(reasons)))
    return Choice(observer, dict(sorted(found.items(), key=lambda item: _rank(item[1]), reverse=True)))


def sound(margins: Margins) -> bool:
    """Whether a loop is stable and its noise seldom reaches the commands' limits."""
    return margins.stable and margins.noise_share <= NOISE_FILLS


def _rank(margins: Margins) -> tuple[bool, bool, float, float]:
    """Sound before stable before unstable; then the margin, or the slower growth."""
    return sound(margins), margins.stable, margins.modulus, margins.slowest_pole_rad_s


def _standing(name: str, margins: Margins) -> str:
    if not margins.stable:
        return f"{name} unstable, growing by {-margins.slowest_pole_rad_s:.3g} 1/s"
    if not sound(margins):
        return f"{name} {margins.modulus:.2g} with noise of {100.0 * margins.noise_share:.0f} % of the command's room"
    return f"{name} {margins.modulus:.2g}"
