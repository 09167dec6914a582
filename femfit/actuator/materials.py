"""A small library of linear materials; an actuator file may name one or define its own."""

from dataclasses import dataclass

from femfit.actuator.parts import LinearMaterial

_MATLIB = "FEMM material library matlib.dat (D. Meeker), entry {}"


@dataclass(frozen=True)
class LibraryMaterial:
    """A material with its source.

    Parameters
    ----------
    material : LinearMaterial
        Values at about 20 degC.
    reference : str
        Where the values come from, and what they leave out.
    """

    material: LinearMaterial
    reference: str


def _magnet(grade: str, remanence_T: float) -> LibraryMaterial:
    return LibraryMaterial(
        LinearMaterial(grade.lower(), relative_permeability=1.05, remanence_T=remanence_T),
        f"{_MATLIB.format(grade)}: B_r = mu_0 mu_r H_c, for N48 and above the end of its demagnetisation curve. "
        "A straight recoil line; makers guarantee B_r to about 2 %.",
    )


_ENTRIES = (
    LibraryMaterial(LinearMaterial("air"), "mu_r = 1 + 4e-7, taken as 1"),
    LibraryMaterial(LinearMaterial("copper"), "mu_r = 1 - 1e-5, taken as 1"),
    LibraryMaterial(LinearMaterial("aluminium"), "mu_r = 1 + 2e-5, taken as 1"),
    LibraryMaterial(
        LinearMaterial("soft_ferrite", relative_permeability=2300.0),
        "Ferroxcube material specification 3C90 (MnZn): initial permeability 2300 +-20 % at 25 degC. Saturation, from "
        "about 0.3 T, is not modelled.",
    ),
    LibraryMaterial(
        LinearMaterial("low_carbon_steel", relative_permeability=1000.0),
        f"{_MATLIB.format('1010 Steel')}: secant B / (mu_0 H) is 1700 at 1.07 T and 1000 at 1.46 T. Saturation is not "
        "modelled: forces are too large wherever the steel exceeds about 1.5 T.",
    ),
    _magnet("N35", 1.195),
    _magnet("N38", 1.247),
    _magnet("N40", 1.280),
    _magnet("N42", 1.312),
    _magnet("N45", 1.359),
    _magnet("N48", 1.405),
    _magnet("N50", 1.435),
    _magnet("N52", 1.464),
)

LIBRARY: dict[str, LibraryMaterial] = {entry.material.name: entry for entry in _ENTRIES}
"""By name, as written in actuator files."""
