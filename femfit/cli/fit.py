"""``femfit fit``: a sweep table to a model file."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import femfit as ff
from femfit.cli.command import OUTPUT, Outcome, Writes, command
from femfit.cli.keywords import Keywords
from femfit.core.errors import FitError
from femfit.core.files import MODEL

if TYPE_CHECKING:
    from femfit.fit.soft_iron import InductanceFit


_FORCES = Keywords("femfit.fit.build:fit_model", "where bounds=bound functions inductance_H")
_DEVICE = Keywords("femfit.fit.build:fit_model", "actuator mass_kg=mass-g resistance_ohm supply_V")

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
    output: Annotated[Path | None, OUTPUT, _BESIDE] = None,
    forces: Annotated[dict[str, Any], _FORCES],
    device: Annotated[dict[str, Any], _DEVICE],
) -> Outcome:
    """Fit a force law or a co-energy to a sweep table, and write the model file.

    Parameters
    ----------
    table : Path
        Sweep table, or the directory that holds it; or a table of measured inductances without forces (distance_mm,
        current_A, inductance_mH), to which --model fits a law.
    model : str
        Kind of model: coenergy, the name of a force law, or all, which ranks every law and writes the recommended one.
    output : Path
        Model file; beside the table by default.
    """
    from femfit.fit.soft_iron import fit_inductance
    from femfit.tables.measurement_file import is_inductance_table, read_inductance_table

    assert output is not None  # noqa: S101 - the default of Writes
    result: ff.FitResult | InductanceFit
    if is_inductance_table(table):
        if forces:
            raise FitError(
                "--where, --bound, --functions and --inductance-H are of a fit to forces; one to measured inductances "
                "has no use for them. Leave them out, or fit a sweep table with forces."
            )
        result = fit_inductance(read_inductance_table(table), law=model, **device)
    else:
        result = ff.fit_model(table, law=model, **forces, **device)
    data = {**result.to_dict(), "model_file": str(output)}
    return Outcome(result, data, [(output, partial(ff.write_model, result.model))])
