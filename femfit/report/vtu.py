"""The field as a file for ParaView."""

from pathlib import Path

import numpy as np

from femfit.core.atomic import write_text
from femfit.report.field_cells import FieldCells
from femfit.report.solved_point import SolvedPoint

TRIANGLE = 5  # VTK's number of the cell


def write_vtu(point: SolvedPoint, cells: FieldCells, path: Path) -> None:
    """Write the half section as an unstructured grid in the plane (r, z, 0), in m.

    Of points: ``A_phi`` (Wb/m), ``flux`` (2 pi r A_phi in Wb, whose contours are the flux lines), ``B`` (T, vector),
    ``B_magnitude``, ``H`` (A/m, vector), ``mu_r``. Of cells: ``region``, the place of its name in the field data
    ``regions``. Field data also: ``distance_m``, ``current_A``, ``force_N``.

    Parameters
    ----------
    point : SolvedPoint
        For what is written beside the field.
    """
    import pyvista
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    def in_space(plane: np.ndarray) -> np.ndarray:
        return np.column_stack([plane, np.zeros(len(plane))])

    count = len(cells.triangles)
    corners = np.column_stack([np.full(count, 3), cells.triangles]).ravel()
    grid = pyvista.UnstructuredGrid(corners, np.full(count, TRIANGLE, dtype=np.uint8), in_space(cells.points_m))
    grid.point_data["A_phi"] = cells.potential_Wb_per_m
    grid.point_data["flux"] = 2.0 * np.pi * cells.points_m[:, 0] * cells.potential_Wb_per_m
    grid.point_data["B"] = in_space(cells.flux_density_T)
    grid.point_data["B_magnitude"] = np.hypot(*cells.flux_density_T.T)
    grid.point_data["H"] = in_space(cells.field_A_per_m)
    grid.point_data["mu_r"] = cells.relative_permeability
    grid.cell_data["region"] = cells.triangle_region
    grid.field_data["regions"] = list(cells.regions)
    for name, value in (("distance_m", point.distance_m), ("current_A", point.current_A), ("force_N", point.force_N)):
        grid.field_data[name] = [value]
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    # VTK does not say that a disk is full, and may crash on it: it writes to memory, and Python to the disk.
    writer.WriteToOutputStringOn()
    writer.Write()
    write_text(path, writer.GetOutputString())
