"""``femfit fit``: a sweep table to a model file."""

import math
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def fit(
    table: Path,
    *,
    model: str = "coenergy",
    where: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    bounds: str = "law",
    bound: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    functions: str | None = None,
    stages: str = "two",
    constraints: str | None = None,
    inductance_H: Annotated[float | None, Parameter(name="--inductance-H")] = None,
    actuator: Path | None = None,
    mass_g: float | None = None,
    resistance_ohm: float | None = None,
    supply_V: Annotated[str | None, Parameter(name="--supply-V")] = None,
    json: Path | None = None,
) -> None:
    """Fit a model to a sweep table, or to measured inductances, and write it.

    Parameters
    ----------
    table : Path
        Sweep table, or the directory that holds it; or a table of measured inductances without forces (distance_mm,
        current_A, inductance_mH), to which --model fits a law.
    model : str
        coenergy, the name of a force law, or all: rank every law and write the recommended one.
    where : tuple of str
        Which variant of a parameter sweep, for example variant=3, coil.turns=250 or
        moving.regions.plunger.material=steel_1010; repeat for more parameters.
    output : Path
        Model file; beside the table by default.
    bounds : str
        Bounds of a law's coefficients: law, none, paper or paper-coefficients.
    bound : tuple of str
        Bounds of one coefficient, for example "d^-4=0:1e-8"; repeat for more; either end may be empty.
    functions : str
        Coefficient functions of the current, one a column, for example constant,through-origin; default: by held-out
        error among constant, through-origin, square, affine and quadratic.
    stages : str
        Coefficients of the two-stage fit (two) or of the one-stage fit (joint) in the model.
    constraints : str
        Shape constraints of the co-energy, any of inductance,decreasing,attracting, or none; default: those that the
        data obey.
    inductance_H : float
        Inductance at the largest distance, for a table without flux linkage.
    actuator : Path
        Actuator file with circuit, mass and sensor, for an imported table.
    mass_g : float
        Mass of the moving part.
    resistance_ohm : float
        Resistance of the winding.
    supply_V : str
        Lowest and highest voltage of the driver, for example 0:12; of a table of inductances.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.outputs import MODEL, RESULT, require_outputs
    from femfit.device.load import read_actuator
    from femfit.device.summary import sweep_manifest_entry
    from femfit.fit.build import FitOptions, fit_model
    from femfit.fit.text import fit_lines
    from femfit.model.json_file import write_model
    from femfit.tables.inductance_table import is_inductance_table
    from femfit.tables.sweep_table import read_sweep_table
    from femfit.tables.variant_choice import choose_variant

    target = output or (table if table.is_dir() else table.parent) / f"model_{model}.json"
    require_outputs([table, actuator], (target, MODEL), (json, RESULT))
    if is_inductance_table(table):
        _fit_inductances(table, target, model, (mass_g, resistance_ohm, _range(supply_V)), json)
        return
    options = FitOptions(
        model=model,
        bounds=bounds,
        coefficient_bounds=dict(_single_bound(text) for text in bound),
        functions=None if functions is None else _names(functions),
        stages=stages,
        constraints=None if constraints is None else _names(constraints),
        inductance_H=inductance_H,
        actuator=sweep_manifest_entry(read_actuator(actuator)) if actuator else None,
        mass_kg=None if mass_g is None else 1e-3 * mass_g,
        resistance_ohm=resistance_ohm,
    )
    result = fit_model(choose_variant(read_sweep_table(table), dict(_single_value(text) for text in where)), options)
    write_model(result.model, target)
    write_json(json, {**result.data, "model_file": str(target)})
    print("\n".join(fit_lines(result)))
    print(f"written: {target}")


def _fit_inductances(
    table: Path,
    target: Path,
    law: str,
    parts: tuple[float | None, float | None, tuple[float, float] | None],
    json: Path | None,
) -> None:
    from femfit.cli.output import write_json
    from femfit.core.errors import FitError
    from femfit.fit.inductance import InductanceOptions, fit_inductance, inductance_lines
    from femfit.model.json_file import write_model
    from femfit.tables.inductance_table import read_inductance_table

    if law in {"coenergy", "all"}:
        raise FitError(
            f"Inductances without forces give a law; --model must name one, for example two-exponentials, "
            f"instead of {law}."
        )
    mass_g, resistance, supply = parts
    mass = None if mass_g is None else 1e-3 * mass_g
    result = fit_inductance(read_inductance_table(table), InductanceOptions(law, mass, resistance, supply))
    write_model(result.model, target)
    write_json(json, {**result.to_dict(), "model_file": str(target)})
    print("\n".join(inductance_lines(result)))
    print(f"written: {target}")


def _range(text: str | None) -> tuple[float, float] | None:
    from femfit.core.errors import FitError

    if text is None:
        return None
    low, _, high = text.partition(":")
    try:
        limits = float(low), float(high)
    except ValueError:
        limits = math.nan, math.nan
    if not limits[0] < limits[1]:
        raise FitError(f"--supply-V must read LOW:HIGH, for example 0:12; instead received {text!r}.")
    return limits


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip() not in {"", "none"})


def _single_value(text: str) -> tuple[str, float | str]:
    """A column and its number, or else its text."""
    from femfit.core.errors import TableError

    name, separator, value = text.partition("=")
    if not separator or not value.strip():
        raise TableError(f"--where must read COLUMN=VALUE, for example variant=3; instead received {text!r}.")
    try:
        return name.strip(), float(value)
    except ValueError:
        return name.strip(), value.strip()


def _single_bound(text: str) -> tuple[str, tuple[float, float]]:
    from femfit.core.errors import FitError

    name, separator, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    try:
        limits = (float(low) if low else -math.inf, float(high) if high else math.inf)
    except ValueError:
        limits = (math.nan, math.nan)
    if not (separator and colon) or any(math.isnan(end) for end in limits):
        raise FitError(f"A bound must read COLUMN=LOW:HIGH, for example d^-4=0:1e-8; instead received {text!r}.")
    return name.strip(), limits
