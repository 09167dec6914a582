"""FEMM models with the peer's results: the imported actuator gives its force, flux linkage and field."""

from dataclasses import replace

import pytest

from femfit.device.sensors import HallElement
from femfit.field.sweep import run_sweep
from femfit.tables.femm.read import import_fem_file
from support.reference import REFERENCE, needs_reference

pytestmark = needs_reference

# Converged forces at 20 mm from the ERRATA beside the paper: F0 + F1 i + F2 i^2
CONVERGED = {0: 0.0261666, 1: 0.0261666 + 0.0085470 + 8.648e-8}

# The peer's mesh: relative error of the reaction on the core and of the flux linkage. 17,300 nodes: at most 5.6 % over
# 15 to 44 mm (xfemm.md), and at 1 A its flux linkage is 0.140 % below 308.2135 uWb, which order 7 with corners at 0.005
# of a part's extent gives. The others have 10,000 nodes and coarser gaps, and one ends at 300 mm.
MODELS = {
    "emaws_d20_i1": (0.056, 0.00145),
    "emaws_d20_i0_automesh": (0.056, 0.0012),
    "emaws_d20_i1_R300_dirichlet": (0.056, 0.005),
}


def peer_result(name):
    line = (REFERENCE / "fem" / f"{name}.result.txt").read_text().splitlines()[-1].split()
    names = ("force", "flux_linkage", "Bz(0,0)", "Bz(3,-0.1)", "core_reaction", "Bz(0,-1)")
    return dict(zip(names, map(float, line[1:7]), strict=True))


def own_row(actuator, directory):
    rows = run_sweep(actuator, directory, workers=1).rows
    assert len(rows) == 1
    assert rows["status"].tolist() == ["ok"]
    return rows.iloc[0]


@pytest.mark.parametrize("name", MODELS)
def test_an_imported_model_gives_the_converged_force_and_the_peers_flux(name, tmp_path):
    reaction_error, flux_error = MODELS[name]
    imported = import_fem_file(REFERENCE / "fem" / f"{name}.fem")
    row, peer = own_row(imported.actuator, tmp_path), peer_result(name)
    assert (row["current_A"], row["distance_m"]) == (1.0 if "i1" in name else 0.0, 0.020)
    # the sweep's own error is below 0.1 % (its force_error_N); the mesh error of the peer's force on the magnet is not
    assert row["force_N"] == pytest.approx(CONVERGED[int(row["current_A"])], rel=1e-3)
    assert row["force_N"] == pytest.approx(-peer["core_reaction"], rel=reaction_error)
    assert row["flux_linkage_Wb"] == pytest.approx(imported.current_signs[0] * peer["flux_linkage"], rel=flux_error)


# (r, z) in mm of the file and the peer's error. B is constant in its first-order elements: over five meshes (see
# emaws_xfemm_meshconv_12pts.csv) it spreads by 2.5 %, 0.6 % and 1.1 %. At 3 mm, beside the edge of the
# core, the finest of them is still 1.1 % off.
FIELD_POINTS = {"Bz(0,0)": (0.0, 0.0, 0.03), "Bz(3,-0.1)": (3.0, -0.1, 0.02), "Bz(0,-1)": (0.0, -1.0, 0.011)}


@pytest.mark.parametrize("point", FIELD_POINTS)
def test_the_field_at_a_point_of_the_file_is_the_peers(point, tmp_path):
    r, z, error = FIELD_POINTS[point]
    imported = import_fem_file(REFERENCE / "fem" / "emaws_d20_i1.fem")
    frame = imported.frame
    element = HallElement(1e-3 * r, 1e-3 * frame.up * (z - frame.face_mm))
    row = own_row(replace(imported.actuator, sensors=(element,)), tmp_path)
    assert row["hall_T"] == pytest.approx(frame.field_sign * peer_result("emaws_d20_i1")[point], rel=error)
