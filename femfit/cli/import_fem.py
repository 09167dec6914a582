"""``femfit import-fem``: a FEMM model as an actuator file."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter


def import_fem(
    model: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    moving_group: Annotated[tuple[int, ...], Parameter(negative=())] = (),
    moving_block: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    moving_label: Annotated[tuple[int, ...], Parameter(negative=())] = (),
    distance_mm: str | None = None,
    current_A: Annotated[str | None, Parameter(name="--current-A")] = None,
    circuit: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    mover_side: Literal["auto", "above", "below"] = "auto",
    face_mm: float | None = None,
    mass_g: float | None = None,
    density_g_per_cm3: Annotated[float | None, Parameter(name="--density-g-per-cm3")] = None,
    resistance_ohm: float | None = None,
    wire_diameter_mm: float | None = None,
    arc_degrees: float = 3.0,
    name: str | None = None,
    json: Path | None = None,
) -> None:
    """Read an axisymmetric magnetic FEMM model (.fem), and write it as an actuator file.

    Parameters
    ----------
    model : Path
        FEMM model (.fem).
    output : Path
        Actuator file (.toml) to write.
    moving_group : tuple of int
        Group of the blocks that move; may be repeated; inferred by default.
    moving_block : tuple of str
        Material name of the blocks that move; may be repeated.
    moving_label : tuple of int
        Place in the file's list, from 1, of a block label in the body that moves; may be repeated.
    distance_mm : str
        Distances of the sweep in mm beside the file's own, start:stop:step or separated by commas.
    current_A : str
        Currents of the sweep in A in each circuit beside the file's own, start:stop:step or separated by commas.
    circuit : tuple of str
        Circuit to take; may be repeated; default: those with current.
    mover_side : str
        Side of the fixed parts on which the moving part stands in the file: higher or lower z.
    face_mm : float
        Height z in mm, in the file, of the fixed parts' face from which distances are counted.
    mass_g : float
        Mass of the moving body in g.
    density_g_per_cm3 : float
        Density of the moving part in g/cm3, for its mass from its volume.
    resistance_ohm : float
        Resistance of the winding in ohm, where there is one.
    wire_diameter_mm : float
        Bare copper diameter of the wire in mm.
    arc_degrees : float
        Largest angle in degrees of the chords that stand for arcs where other lines cross them.
    name : str
        Name of the actuator; default: the one from the file's name.
    json : Path
        File for the findings as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.files import DRAWING, RESULT, require_outputs, write_text
    from femfit.tables.femm.options import FemOptions, axis_option
    from femfit.tables.femm.read import import_fem_file

    require_outputs([model], (output, DRAWING), (json, RESULT))
    options = FemOptions(
        moving_groups=moving_group,
        moving_blocks=moving_block,
        moving_labels=moving_label,
        circuits=circuit,
        mover_side=mover_side,
        face_mm=face_mm,
        distances_mm=axis_option(distance_mm, "--distance-mm"),
        currents_A=axis_option(current_A, "--current-A"),
        mass_g=mass_g,
        density_g_per_cm3=density_g_per_cm3,
        resistance_ohm=resistance_ohm,
        wire_diameter_mm=wire_diameter_mm,
        arc_degrees=arc_degrees,
        name=name,
    )
    imported = import_fem_file(model, options)
    write_text(output, imported.toml)
    print(imported)
    print(f"written: {output}")
    write_json(json, imported.as_dict())
