"""FEMM materials with B-H curves: written point by point, and solved as the peer does."""

import pytest

from femfit.field.sweep import run_sweep
from femfit.tables.femm.read import import_fem, import_fem_file
from support.fem_files import STEEL, suspension
from support.reference import REFERENCE, needs_reference


def with_curve(curve):
    drawing = suspension()
    drawing.materials[STEEL]["curve"] = curve
    return import_fem(drawing.content(), "model.fem")


def test_a_curve_is_written_point_by_point():
    curve = ((0, 0), (1.1, 180.5), (1.6, 3000), (1.9, 16000), (2.2, 110000))
    (region,) = with_curve(curve).actuator.fixed
    assert tuple(zip(region.material.flux_density_T, region.material.field_A_per_m, strict=True)) == curve


def test_the_end_of_a_curve_below_the_slope_of_vacuum_is_left_out():
    curve = ((0, 0), (1.1, 180.5), (1.6, 3000), (1.9, 16000), (2.2, 110000), (2.25, 190000), (2.3, 290000))
    result = with_curve(curve)  # 0.5 mu_0 at the end
    assert result.actuator.fixed[0].material.flux_density_T == (0, 1.1, 1.6, 1.9, 2.2)
    (finding,) = [finding for finding in result.findings if finding.code == "curve-end"]
    assert "last 2 of 7 points" in finding.text


@needs_reference
def test_a_saturating_model_gives_the_peers_force_and_flux(tmp_path):
    imported = import_fem_file(REFERENCE / "fem" / "steel_d5_i3.fem")
    assert imported.actuator.fixed[0].material == imported.actuator.moving.regions[0].material
    (row,) = run_sweep(imported.actuator, tmp_path, workers=1).rows.to_dict("records")
    values = (REFERENCE / "fem" / "steel_d5_i3.result.txt").read_text().splitlines()[-1].split()
    force, flux_linkage = float(values[1]), float(values[2])
    assert (row["current_A"], row["distance_m"]) == (3.0, 0.005)
    assert row["status"] == "ok"
    # 15,000 nodes: the peer's force changes by up to 0.52 % to its mesh of 23,000 (steel_xfemm_fine.csv); the flux
    # linkage of its first-order elements is up to 0.12 % low (xfemm.md), and its B-H curve is a natural spline
    assert row["force_N"] == pytest.approx(force, rel=5.2e-3)
    assert row["flux_linkage_Wb"] == pytest.approx(flux_linkage, rel=2e-3)
