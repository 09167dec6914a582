"""A published parameter set as a file: what a paper or a data sheet prints of an actuator, its law and its filter.

Every section is optional; a check runs where it finds what it needs. Numbers stand as printed, in SI but for lengths
(mm) and masses (g) whose keys say so.
"""

import tomllib
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from femfit.core.errors import TableError


class Section(BaseModel):
    """A section: unknown keys, NaN and infinity are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class Magnet(Section):
    """``[magnet]``: a cylinder."""

    diameter_mm: float = Field(gt=0)
    height_mm: float = Field(gt=0)
    mass_g: float = Field(gt=0)
    density_kg_m3: float = Field(7500.0, gt=0)
    remanence_T: float | None = Field(None, gt=0)


class CoilSection(Section):
    """``[coil]``: the winding, and what a field solution of its core gives for one turn."""

    turns: float | None = Field(None, gt=0)
    wire_diameter_mm: float | None = Field(None, gt=0)
    inner_diameter_mm: float | None = Field(None, gt=0)
    outer_diameter_mm: float | None = Field(None, gt=0)
    height_mm: float | None = Field(None, gt=0)
    resistance_ohm: float | None = Field(None, gt=0)
    inductance_H: float | None = Field(None, gt=0)
    inductance_per_turn2_H: float | None = Field(None, gt=0)
    force_per_ampere_turn_N: float | None = Field(None, gt=0)
    force_distance_mm: float | None = Field(None, gt=0)


class Term(Section):
    """One term c d^p i^q of a force law or of an acceleration."""

    value: float
    distance_power: int
    current_power: int = Field(0, ge=0)


class StageOneRow(Section):
    """A row of coefficients fitted at one current."""

    current_A: float
    a: float
    b: float
    J1: float = Field(gt=0)
    c: float | None = None


class ForceSection(Section):
    """``[force]``: the law F = sum c d^p i^q in N, how it was fitted, and what the fit printed."""

    terms: list[Term] = Field(min_length=1)
    terms_again: list[Term] = []
    terms_again_where: str = ""
    distance_min_mm: float = Field(gt=0)
    distance_max_mm: float = Field(gt=0)
    points: int = Field(gt=1)
    lower_bound: float | None = None
    upper_bound: float | None = None
    bounds_hold_for_slacks: bool = False
    rows: list[StageOneRow] = []
    mean_a: float | None = None
    slope_b: float | None = None
    J3: float | None = Field(None, gt=0)
    difference_step_A: float | None = Field(None, gt=0)
    difference_mean_N: float | None = None
    difference_sd_N: float | None = None
    says_linear_in_current: bool = False


class SupplySection(Section):
    """``[supply]``: the driver's clamp, and the range that is said to be held with it."""

    voltage_min_V: float
    voltage_max_V: float
    held_min_mm: float = Field(gt=0)
    held_max_mm: float = Field(gt=0)


class EquationSection(Section):
    """``[equations]``: the state equations as printed, x = (d, v, i), d growing away from the electromagnet."""

    gravity_m_s2: list[float] = Field(min_length=1)
    acceleration_terms: list[Term] = Field(min_length=1)
    current_per_A: float
    current_per_V: float
    has_back_emf: bool


class FilterSection(Section):
    """``[filter]``: an unscented Kalman filter."""

    states: int = Field(gt=0)
    alpha: float = Field(gt=0)
    beta: float
    kappa: float
    mean_weights: list[float] = []
    covariance_weights: list[float] = []
    process_noise: list[float] = []
    measurement_noise: float | None = Field(None, gt=0)
    noise_unit: str = ""
    single_precision: bool = False
    sample_time_s: float = Field(gt=0)
    direct_rms_m: list[float] = []
    filtered_rms_m: list[float] = []


class HallSection(Section):
    """``[hall]``: output in V to distance in mm, d = sum_k p_k (v_hall + c)^k with the highest power first."""

    constant_V: float
    quiescent_V: float
    polynomial_mm: list[float] = Field(min_length=2)
    sensitivity_V_per_T: float | None = Field(None, gt=0)


class PidSection(Section):
    """``[pid]``: u(k) = sum past_k u(k - k) + sum error_k e(k - k) as printed."""

    past: list[float] = Field(min_length=1)
    error: list[float] = Field(min_length=2)


class ParameterSet(Section):
    """A whole file."""

    name: str
    source: str
    magnet: Magnet | None = None
    coil: CoilSection | None = None
    force: ForceSection | None = None
    supply: SupplySection | None = None
    equations: EquationSection | None = None
    filter: FilterSection | None = None
    hall: HallSection | None = None
    pid: PidSection | None = None


def read_parameters(path: Path) -> ParameterSet:
    """Read a parameter set.

    Returns
    -------
    ParameterSet
        Checked for keys and types, not for sense.

    Raises
    ------
    TableError
        If it is no such file; with every problem at once.
    """
    try:
        data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TableError(f"{path} must be TOML; {error}.") from error
    if "schema" in data:
        raise TableError(
            f"{path} is an actuator file; audit its model: femfit sweep, femfit fit, then audit MODEL.json."
        )
    try:
        return ParameterSet.model_validate(data)
    except ValidationError as error:
        problems = "\n".join(f"  - {'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors())
        raise TableError(f"{path} is no parameter set:\n{problems}") from error
