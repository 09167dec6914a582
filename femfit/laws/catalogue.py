"""The catalogue of force laws: one tuple."""

from femfit.core.public import require_known
from femfit.laws.dipoles import (
    DIPOLE_DISK,
    DIPOLE_LOOP,
    F1E,
    F2E,
    INVERSE_POWERS,
    RATIONAL,
    SHIFTED_F1E,
    SHIFTED_MULTIPOLES,
    SHIFTED_POWERS,
    TWO_DIPOLES,
)
from femfit.laws.exponentials import EXPONENTIAL_HARMONICS, MOVING_COIL, TWO_EXPONENTIALS
from femfit.laws.law import ForceLaw

BUILT_IN: tuple[ForceLaw, ...] = (
    F1E,
    F2E,
    SHIFTED_F1E,
    TWO_DIPOLES,
    INVERSE_POWERS,
    SHIFTED_POWERS,
    SHIFTED_MULTIPOLES,
    DIPOLE_LOOP,
    DIPOLE_DISK,
    RATIONAL,
    TWO_EXPONENTIALS,
    EXPONENTIAL_HARMONICS,
    MOVING_COIL,
)


def all_laws() -> dict[str, ForceLaw]:
    """Every law by its name, in the catalogue's order.

    Examples
    --------
    >>> import femfit as ff
    >>> ff.list_laws()["F1e"].formula
    'a d^-4 + b d^-2'
    """
    return {law.name: law for law in BUILT_IN}


def law_by_name(name: str) -> ForceLaw:
    """Look up a law, or :class:`UsageError` with those that there are."""
    laws = all_laws()
    require_known("Force law", [name], laws)
    return laws[name]
