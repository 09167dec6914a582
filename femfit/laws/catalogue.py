"""The catalogue of force laws: one tuple; third parties add theirs by the entry point ``femfit.laws``."""

from importlib.metadata import entry_points

from femfit.core.entry_catalogue import EntryCatalogue
from femfit.laws.dipole_disk import DIPOLE_DISK
from femfit.laws.dipole_loop import DIPOLE_LOOP
from femfit.laws.exponential_harmonics import EXPONENTIAL_HARMONICS
from femfit.laws.f1e import F1E
from femfit.laws.f2e import F2E
from femfit.laws.inverse_powers import INVERSE_POWERS
from femfit.laws.law import ForceLaw
from femfit.laws.moving_coil import MOVING_COIL
from femfit.laws.rational import RATIONAL
from femfit.laws.shifted_f1e import SHIFTED_F1E
from femfit.laws.shifted_multipoles import SHIFTED_MULTIPOLES
from femfit.laws.shifted_powers import SHIFTED_POWERS
from femfit.laws.two_dipoles import TWO_DIPOLES
from femfit.laws.two_exponentials import TWO_EXPONENTIALS

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

GROUP = "femfit.laws"
"""Entry points of other packages' laws, each named as its law."""

_CATALOGUE = EntryCatalogue(ForceLaw, "Force law", BUILT_IN)


def all_laws() -> dict[str, ForceLaw]:
    """Every law by its name: those of femfit, then those of installed packages.

    Returns
    -------
    dict of str to ForceLaw
        In the catalogue's order; a name of femfit's own cannot be taken by another package.

    Raises
    ------
    ModelFileError
        If an installed package's law cannot be loaded.

    Examples
    --------
    >>> import femfit as ff
    >>> ff.list_laws()["F1e"].formula
    'a d^-4 + b d^-2'
    """
    return _CATALOGUE.all(entry_points(group=GROUP))


def law_by_name(name: str) -> ForceLaw:
    """Look up a law; only the package that gives it is loaded."""
    return _CATALOGUE.find(name, lambda: entry_points(group=GROUP))
