"""``femfit fit``: a sweep table to a model file."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def fit(
    table: Path,
    *,
    model: str = "coenergy",
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    bounds: str = "law",
    stages: str = "two",
    shape: tuple[str, ...] | None = None,
    inductance_H: Annotated[float | None, Parameter(name="--inductance-H")] = None,
    actuator: Path | None = None,
    mass_g: float | None = None,
    resistance_ohm: float | None = None,
    json: Path | None = None,
) -> None:
    """Fit a model to a sweep table and write it.

    Parameters
    ----------
    table : Path
        Sweep table, or the directory that holds it.
    model : str
        Name of a force law, or coenergy.
    output : Path
        Model file; beside the table by default.
    bounds : str
        Bounds of a law's coefficients: law, none, paper or paper-coefficients.
    stages : str
        Coefficients of the two-stage fit (two) or of the one-stage fit (joint) in the model.
    shape : tuple of str
        Shape constraints of the co-energy: inductance, decreasing, attracting; default: those the data obey.
    inductance_H : float
        Inductance at the largest distance, for a table without flux linkage.
    actuator : Path
        Actuator file with circuit, mass and sensor, for an imported table.
    mass_g : float
        Mass of the moving part.
    resistance_ohm : float
        Resistance of the winding.
    json : Path
        File for the result as JSON.
    """
    import json as json_format

    from femfit.actuator.load import read_actuator
    from femfit.actuator.summary import sweep_manifest_entry
    from femfit.core.sweep_table import read_sweep_table
    from femfit.fit.build import FitOptions, fit_model
    from femfit.fit.text import fit_lines
    from femfit.model.json_file import write_model

    options = FitOptions(
        model=model,
        bounds=bounds,
        stages=stages,
        shapes=shape,
        inductance_H=inductance_H,
        actuator=sweep_manifest_entry(read_actuator(actuator)) if actuator else None,
        mass_kg=None if mass_g is None else 1e-3 * mass_g,
        resistance_ohm=resistance_ohm,
    )
    result = fit_model(read_sweep_table(table), options)
    target = output or (table if table.is_dir() else table.parent) / f"model_{model}.json"
    write_model(result.model, target)
    print("\n".join(fit_lines(result)))
    print(f"written: {target}")
    if json is not None:
        json.write_text(json_format.dumps(result.data, indent=1) + "\n", encoding="utf-8")
