"""The catalogue of force laws: one tuple; third parties add theirs by the entry point ``femfit.laws``."""

from importlib.metadata import entry_points

from femfit.core.errors import ModelFileError
from femfit.laws.f1e import F1E
from femfit.laws.law import ForceLaw

BUILT_IN: tuple[ForceLaw, ...] = (F1E,)


def all_laws() -> dict[str, ForceLaw]:
    """Every law by its name: those of femfit, then those of installed packages.

    Returns
    -------
    dict of str to ForceLaw
        In the catalogue's order.
    """
    laws = {law.name: law for law in BUILT_IN}
    for entry in entry_points(group="femfit.laws"):
        law = entry.load()
        laws.setdefault(law.name, law)
    return laws


def law_by_name(name: str) -> ForceLaw:
    """Look up a law.

    Parameters
    ----------
    name : str
        As in the model file; case counts.

    Returns
    -------
    ForceLaw
        The law.

    Raises
    ------
    ModelFileError
        If no law has this name.
    """
    laws = all_laws()
    if name not in laws:
        raise ModelFileError(f"Force law must be one of {', '.join(laws)}; instead received {name!r}.")
    return laws[name]
