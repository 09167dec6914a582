"""``femfit fit``: a sweep table to a model file."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from femfit.cli.command import FLAG, OUTPUT, Outcome, Writes, command, names_of, pairs, parsed
from femfit.core.errors import FitError
from femfit.core.files import MODEL

if TYPE_CHECKING:
    from femfit.fit.inductance import InductanceFit
    from femfit.fit.result import FitResult


_BESIDE = Writes(
    MODEL,
    default=lambda arguments: (
        (arguments["table"] if arguments["table"].is_dir() else arguments["table"].parent)
        / f"model_{arguments['model']}.json"
    ),
)


@command()
def fit(
    table: Path,
    *,
    model: str = "coenergy",
    where: Annotated[tuple[str, ...], FLAG] = (),
    output: Annotated[Path | None, OUTPUT, _BESIDE] = None,
    bound: Annotated[tuple[str, ...], FLAG] = (),
    functions: str | None = None,
    constraints: str | None = None,
    inductance_H: Annotated[float | None, Parameter(name="--inductance-H")] = None,
    actuator: Path | None = None,
    mass_g: float | None = None,
    resistance_ohm: float | None = None,
    supply_V: Annotated[str | None, Parameter(name="--supply-V")] = None,
) -> Outcome:
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
    """
    from femfit.fit.build import fit_model
    from femfit.fit.inductance import fit_inductance
    from femfit.model.json_file import write_model
    from femfit.tables.measured_tables import is_inductance_table, read_inductance_table

    assert output is not None  # noqa: S101 - the default of Writes
    device: dict[str, Any] = {
        "actuator": actuator,
        "mass_kg": None if mass_g is None else 1e-3 * mass_g,
        "resistance_ohm": resistance_ohm,
        "supply_V": None if supply_V is None else parsed(supply_V, "--supply-V", "LOW:HIGH", "0:12", _rising),
    }
    result: FitResult | InductanceFit
    if is_inductance_table(table):
        useless = (where, bound, functions, constraints, inductance_H)
        for (option, purpose), value in zip(_FOR_SWEEPS.items(), useless, strict=True):
            if value not in (None, ()):
                raise FitError(
                    f"{option} {purpose}; a fit to measured inductances has no use for it. Leave it out, or fit a "
                    "sweep table with forces."
                )
        result = fit_inductance(read_inductance_table(table), law=model, **device)
    else:
        result = fit_model(
            table,
            law=model,
            bounds=pairs(bound, "--bound", "COLUMN=LOW:HIGH", "d^-4=0:1e-8", _limits),
            functions=_names(functions),
            constraints=_names(constraints),
            inductance_H=inductance_H,
            where=pairs(where, "--where", "COLUMN=VALUE", "variant=3", _number_or_text),
            **device,
        )
    data = {**result.to_dict(), "model_file": str(output)}
    return Outcome(result, data, [(output, partial(write_model, result.model))])


_FOR_SWEEPS = {
    "--where": "chooses a variant of a parameter sweep",
    "--bound": "bounds a coefficient of a force law",
    "--functions": "sets how a force law depends on the current, which is by its square here",
    "--constraints": "shapes a co-energy",
    "--inductance-H": "stands in for inductances that the table does not have",
}


def _rising(text: str) -> tuple[float, float]:
    """LOW:HIGH of a supply."""
    low, _, high = text.partition(":")
    if not float(low) < float(high):
        raise ValueError(text)
    return float(low), float(high)


def _names(text: str | None) -> tuple[str, ...] | None:
    """Names with commas; the word none is none of them."""
    return None if text is None else tuple(name for name in names_of(text) if name != "none")


def _limits(text: str) -> tuple[float, float]:
    """LOW:HIGH, either of which may be empty."""
    low, colon, high = text.partition(":")
    limits = (float(low or -math.inf), float(high or math.inf))
    if not colon or any(map(math.isnan, limits)):
        raise ValueError(text)
    return limits


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
