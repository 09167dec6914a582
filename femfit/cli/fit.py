"""``femfit fit``: a sweep table to a model file."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from femfit.fit.inductance import InductanceFit
    from femfit.fit.result import FitResult


def fit(
    table: Path,
    *,
    model: str = "coenergy",
    where: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    bound: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    functions: str | None = None,
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
        Kind of model: coenergy, the name of a force law, or all, which ranks every law and writes the recommended one.
    where : tuple of str
        Variant of a parameter sweep, for example variant=3, coil.turns=250 or
        moving.regions.plunger.material=steel_1010; repeat for more parameters.
    output : Path
        Model file; beside the table by default.
    bound : tuple of str
        Bounds of one of a law's coefficients, either of which may be empty, for example "d^-4=0:1e-8"; repeat for more.
    functions : str
        Coefficient functions of the current, one a column, for example constant,through-origin; default: by held-out
        error among constant, through-origin, square, affine and quadratic.
    constraints : str
        Shape constraints of the co-energy, any of inductance,decreasing,attracting, or none; default: those that the
        data obey.
    inductance_H : float
        Inductance in H at the largest distance, for a table without flux linkage.
    actuator : Path
        Actuator file with circuit, mass and sensor, for an imported table.
    mass_g : float
        Mass of the moving part in g.
    resistance_ohm : float
        Resistance of the winding in ohm.
    supply_V : str
        Lowest and highest voltage of the driver in V, for example 0:12.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.files import MODEL, RESULT, require_outputs
    from femfit.fit.build import fit_model
    from femfit.fit.inductance import fit_inductance
    from femfit.model.json_file import write_model
    from femfit.tables.impedance_table import is_inductance_table, read_inductance_table

    target = output or (table if table.is_dir() else table.parent) / f"model_{model}.json"
    require_outputs([table, actuator], (target, MODEL), (json, RESULT))
    mass = None if mass_g is None else 1e-3 * mass_g
    result: FitResult | InductanceFit
    if is_inductance_table(table):
        _require_of_inductances(
            {
                "--where": where,
                "--bound": bound,
                "--functions": functions,
                "--constraints": constraints,
                "--inductance-H": inductance_H,
            }
        )
        result = fit_inductance(
            read_inductance_table(table),
            actuator=actuator,
            law=model,
            mass_kg=mass,
            resistance_ohm=resistance_ohm,
            supply_V=_range(supply_V),
        )
    else:
        result = fit_model(
            table,
            law=model,
            bounds=dict(_single_bound(text) for text in bound),
            functions=None if functions is None else _names(functions),
            constraints=None if constraints is None else _names(constraints),
            inductance_H=inductance_H,
            actuator=actuator,
            mass_kg=mass,
            resistance_ohm=resistance_ohm,
            supply_V=_range(supply_V),
            where=dict(_single_value(text) for text in where),
        )
    write_model(result.model, target)
    write_json(json, {**result.to_dict(), "model_file": str(target)})
    print(result)
    print(f"written: {target}")


_FOR_SWEEPS = {
    "--where": "chooses a variant of a parameter sweep",
    "--bound": "bounds a coefficient of a force law",
    "--functions": "sets how a force law depends on the current, which is by its square here",
    "--constraints": "shapes a co-energy",
    "--inductance-H": "stands in for inductances that the table does not have",
}


def _require_of_inductances(options: dict[str, object]) -> None:
    """Refuse options that do nothing for a table of inductances."""
    from femfit.core.errors import FitError

    for option, value in options.items():
        if value not in (None, ()):
            raise FitError(
                f"{option} {_FOR_SWEEPS[option]}; a fit to measured inductances has no use for it. Leave it out, or "
                "fit a sweep table with forces."
            )


def _range(text: str | None) -> tuple[float, float] | None:
    from femfit.core.errors import UsageError

    if text is None:
        return None
    low, _, high = text.partition(":")
    try:
        limits = float(low), float(high)
    except ValueError:
        limits = math.nan, math.nan
    if not limits[0] < limits[1]:
        raise UsageError(f"--supply-V must read LOW:HIGH, for example 0:12; instead received {text!r}.")
    return limits


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip() not in {"", "none"})


def _single_value(text: str) -> tuple[str, float | str]:
    """A column and its number, or else its text."""
    from femfit.core.errors import UsageError

    name, separator, value = text.partition("=")
    if not separator or not value.strip():
        raise UsageError(f"--where must read COLUMN=VALUE, for example variant=3; instead received {text!r}.")
    try:
        return name.strip(), float(value)
    except ValueError:
        return name.strip(), value.strip()


def _single_bound(text: str) -> tuple[str, tuple[float, float]]:
    from femfit.core.errors import UsageError

    name, separator, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    try:
        limits = (float(low) if low else -math.inf, float(high) if high else math.inf)
    except ValueError:
        limits = (math.nan, math.nan)
    if not (separator and colon) or any(math.isnan(end) for end in limits):
        raise UsageError(f"A bound must read COLUMN=LOW:HIGH, for example d^-4=0:1e-8; instead received {text!r}.")
    return name.strip(), limits
