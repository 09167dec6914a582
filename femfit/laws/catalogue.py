"""The catalogue of force laws: one tuple; third parties add theirs by the entry point ``femfit.laws``."""

from importlib.metadata import entry_points

from femfit.core.entry_catalogue import EntryCatalogue
from femfit.laws.dipoles import DIPOLE_DISK, DIPOLE_LOOP, F1E, F2E, SHIFTED_F1E, TWO_DIPOLES
from femfit.laws.exponentials import EXPONENTIAL_HARMONICS, MOVING_COIL, TWO_EXPONENTIALS
from femfit.laws.law import ForceLaw
from femfit.laws.powers import INVERSE_POWERS, RATIONAL, SHIFTED_MULTIPOLES, SHIFTED_POWERS

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
