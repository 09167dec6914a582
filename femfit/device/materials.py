"""A small library of materials; an actuator file may name one or define its own."""

from dataclasses import dataclass
from pathlib import Path

from femfit.core.errors import ActuatorFileError
from femfit.device.bh import read_bh_csv
from femfit.device.parts import LinearMaterial, Material, NonlinearMaterial
from femfit.device.thermal import ThermalMaterial

NDFEB_COEFFICIENT = -1.2e-3
"""Relative change of B_r per kelvin, alpha(B_r) of the grades N30 to N55 in the list of grades of Arnold Magnetic
Technologies, "Neodymium Iron Boron Magnet Catalog"; FEMM's library has -0.109 %/K in the mean for N30EH."""

NDFEB_CONDUCTIVITY = 0.667e6
"""In S/m, of the entries N35 to N52 of FEMM: 150 uOhm cm; makers say 130 to 180."""

NDFEB_WORKING_TEMPERATURE = 80.0
"""In degC, of grades without a letter for a higher coercivity behind their number; e-magnets UK, Neodymium Temperature
Ratings, for magnets at a high working point: a thin one in an opposing field is demagnetised below it."""

_MATLIB = "FEMM material library matlib.dat (D. Meeker), entry {}"


@dataclass(frozen=True)
class LibraryMaterial:
    """A material with its source."""

    material: Material
    reference: str  # Where the values come from, and what they leave out


def _magnet(grade: str, remanence_T: float) -> LibraryMaterial:
    return LibraryMaterial(
        LinearMaterial(
            grade.lower(),
            1.05,
            remanence_T,
            NDFEB_COEFFICIENT,
            conductivity_S_per_m=NDFEB_CONDUCTIVITY,
            thermal=ThermalMaterial(working_temperature_C=NDFEB_WORKING_TEMPERATURE),
        ),
        f"{_MATLIB.format(grade)}: B_r = mu_0 mu_r H_c, for N48 and above the end of its demagnetisation curve. "
        "A straight recoil line; makers guarantee B_r to about 2 %. Temperature coefficient: Arnold Magnetic "
        "Technologies, Neodymium Iron Boron Magnet Catalog, list of grades. Conductivity: 0.667 MS/m "
        "of the same entry; makers say 130 to 180 uOhm cm. Largest working temperature 80 degC: e-magnets UK, "
        "Neodymium Temperature Ratings, standard grades.",
    )


def _saturating(name: str, reference: str, conductivity_S_per_m: float = 0.0) -> LibraryMaterial:
    """A curve of the folder beside this file, whose comments repeat the source."""
    file = Path(__file__).with_name("bh_curves") / f"{name}.csv"
    points, problems = read_bh_csv(file)
    if points is None:
        raise ActuatorFileError(str(file), problems)
    return LibraryMaterial(NonlinearMaterial(name, *points, conductivity_S_per_m=conductivity_S_per_m), reference)


STEEL_1010 = 6.99e6
"""Conductivity in S/m."""

_OF_1010 = "6.99 MS/m, 143 nOhm m of AISI 1010 at 20 degC, annealed."

_ENTRIES = (
    LibraryMaterial(LinearMaterial("air"), "mu_r = 1 + 4e-7, taken as 1"),
    LibraryMaterial(
        LinearMaterial("copper", conductivity_S_per_m=58.0e6),
        "mu_r = 1 - 1e-5, taken as 1. Conductivity: 58.0 MS/m at 20 degC, annealed (IACS, IEC 60028).",
    ),
    LibraryMaterial(
        LinearMaterial("aluminium", conductivity_S_per_m=34.45e6, thermal=ThermalMaterial(237.0, 2.44e6)),
        f"mu_r = 1 + 2e-5, taken as 1. Conductivity: 34.45 MS/m, {_MATLIB.format('Aluminum, 1100')}; alloys conduct "
        "less, 6061-T6 24.6 MS/m.",
    ),
    LibraryMaterial(
        LinearMaterial("soft_ferrite", relative_permeability=2300.0),
        "Ferroxcube, data handbook Soft Ferrites and Accessories, material 3C90 (MnZn): nominal initial permeability "
        "2300 at 25 degC. Saturation is not modelled. Conductivity: taken as 0; with the 5 ohm m of the data sheet the "
        "skin depth at 10 kHz is 0.2 m.",
    ),
    LibraryMaterial(
        LinearMaterial("low_carbon_steel", relative_permeability=1000.0, conductivity_S_per_m=STEEL_1010),
        f"{_MATLIB.format('1010 Steel')}: secant B / (mu_0 H) is 1700 at 1.07 T and 1000 at 1.46 T. Saturation is not "
        "modelled: forces are too large wherever the steel exceeds about 1.5 T; steel_1010 saturates. "
        f"Conductivity: {_OF_1010}",
    ),
    _saturating(
        "steel_1010",
        f"{_MATLIB.format('1010 Steel')}, annealed; no hysteresis. Conductivity: {_OF_1010}",
        STEEL_1010,
    ),
    _saturating(
        "steel_1018",
        f"{_MATLIB.format('1018 Steel')}; no hysteresis. Conductivity: 5.8 MS/m of the same entry; 159 nOhm m at 0 "
        "and 219 at 100 degC (AISI 1018, annealed) are 5.85 MS/m at 20 degC.",
        5.8e6,
    ),
    _saturating(
        "steel_ss400",
        "TEAM workshop problem 20, measured: COMPEL 14 (1995) 57; no hysteresis. Conductivity: 7.505 MS/m, the steel "
        "of TEAM workshop problem 10, from the same laboratory.",
        7.505e6,
    ),
    _saturating(
        "ferrite_k10",
        "TDK SIFERRIT K10 (NiZn), 25 degC: initial permeability 800 +-25 % and 0.285 T at 2 kA/m, as in OpenMagnetics "
        "MAS 05457ee; between them a Froehlich-Kennelly curve. At 100 degC it saturates at 0.21 T. "
        "Conductivity: taken as 0; NiZn ferrites have 1e5 ohm m or so.",
    ),
    _magnet("N35", 1.195),
    _magnet("N38", 1.247),
    _magnet("N40", 1.280),
    _magnet("N42", 1.312),
    _magnet("N45", 1.359),
    _magnet("N48", 1.405),
    _magnet("N50", 1.435),
    _magnet("N52", 1.464),
    LibraryMaterial(
        LinearMaterial(
            "smco26",
            1.10,
            1.049,
            -3.0e-4,
            conductivity_S_per_m=1.16e6,
            thermal=ThermalMaterial(working_temperature_C=300.0),
        ),
        f"Sm2Co17, {_MATLIB.format('SmCo26')}: B_r = mu_0 mu_r H_c. Temperature coefficient and largest working "
        "temperature: Magnet Sales & Manufacturing, Table of Properties for SmCo Magnets. Conductivity: 1.16 MS/m of "
        "the same entry; makers say 86 uOhm cm.",
    ),
    LibraryMaterial(
        LinearMaterial("ferrite_y30", 1.07, 0.387, -2.0e-3, thermal=ThermalMaterial(2.9, 4.1e6, 250.0)),
        f"{_MATLIB.format('Y30')}: B_r, the end of its demagnetisation curve, which bends below 0.15 T; here it is "
        "straight. Permeability 1.05 to 1.1 and -0.2 %/K of B_r: IEC 60404-8-1, hard ferrites. They are demagnetised "
        "in the cold rather than in the warmth; 250 degC at most, 2.9 W/(m K), 0.825 J/(g K) and 5 g/cm^3: makers' "
        "sheets. Conductivity: taken as 0.",
    ),
)

LIBRARY: dict[str, LibraryMaterial] = {entry.material.name: entry for entry in _ENTRIES}
"""By name, as written in actuator files."""
