"""``femfit fit``: a sweep table to a model file."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import femfit as ff
from femfit.cli.command import OUTPUT, Outcome, Writes, command, names_of, pairs, parsed
from femfit.core.errors import FitError
from femfit.core.files import MODEL

if TYPE_CHECKING:
    from femfit.fit.soft_iron import InductanceFit


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
    where: tuple[str, ...] = (),
    output: Annotated[Path | None, OUTPUT, _BESIDE] = None,
    bound: tuple[str, ...] = (),
    functions: str | None = None,
    inductance_H: float | None = None,
    actuator: Path | None = None,
    mass_g: float | None = None,
    resistance_ohm: float | None = None,
    supply_V: str | None = None,
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
    from femfit.fit.soft_iron import fit_inductance
    from femfit.tables.measurement_file import is_inductance_table, read_inductance_table

    assert output is not None  # noqa: S101 - the default of Writes
    device: dict[str, Any] = {
        "actuator": actuator,
        "mass_kg": None if mass_g is None else 1e-3 * mass_g,
        "resistance_ohm": resistance_ohm,
        "supply_V": None if supply_V is None else parsed(supply_V, "--supply-V", "LOW:HIGH", "0:12", _limits),
    }
    result: ff.FitResult | InductanceFit
    if is_inductance_table(table):
        if any(value not in (None, ()) for value in (where, bound, functions, inductance_H)):
            raise FitError(
                "--where, --bound, --functions and --inductance-H are of a fit to forces; one to measured inductances "
                "has no use for them. Leave them out, or fit a sweep table with forces."
            )
        result = fit_inductance(read_inductance_table(table), law=model, **device)
    else:
        result = ff.fit_model(
            table,
            law=model,
            bounds=pairs(bound, "--bound", "COLUMN=LOW:HIGH", "d^-4=0:1e-8", _limits),
            functions=names_of(functions) or None,
            inductance_H=inductance_H,
            where=pairs(where, "--where", "COLUMN=VALUE", "variant=3", _number_or_text),
            **device,
        )
    data = {**result.to_dict(), "model_file": str(output)}
    return Outcome(result, data, [(output, partial(ff.write_model, result.model))])


def _limits(text: str) -> tuple[float, float]:
    """LOW:HIGH, either of which may be empty."""
    low, colon, high = text.partition(":")
    limits = (float(low or -math.inf), float(high or math.inf))
    if not (colon and limits[0] <= limits[1]):
        raise ValueError(text)
    return limits


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
