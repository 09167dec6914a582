"""What the numbers of a drawing change of its impedances, against other drawings on meshes of their own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import femfit.device.drawn_numbers as drawn_numbers_module
from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.field.signature_rows import impedance_slopes
from support.eddy_transient import mesh_for
from support.small_drawing import POT

POT_MAGNET = (Path(__file__).parents[2] / "geometry" / "pot-magnet.toml").read_text()

RINGED = (
    POT.replace(
        "[fixed.regions.pot]",
        """
[materials.copper]
relative_permeability = 1
conductivity_MS_per_m = 58

[materials.sheets]
relative_permeability = 500
conductivity_MS_per_m = 2
lamination_mm = 0.5

[fixed.regions.ring]
material = "copper"
r_mm = [5.2, 9.3]
z_mm = [-1.8, -1.2]

[fixed.regions.pot]""",
    )
    .replace('[moving.regions.disc]\nmaterial = "iron"', '[moving.regions.disc]\nmaterial = "sheets"')
    .replace("remanence_T", "conductivity_MS_per_m = 0.7\nremanence_T")
)
"""A pot with a copper ring, a disc of sheets and a magnet that conducts: every kind of number."""

MESH_NOISE = (8e-5,) * 3  # of L: two meshes of the pot differ by 1e-5 to 6e-5 of it
# Those of the pot magnet by 6e-6 at 10 Hz, 9e-5 at 300 Hz and 1.23e-4 at 5 kHz, where the flux is left in a thin skin
MESH_NOISE_HIGH = (1e-5, 1e-4, 1.3e-4)
SECOND_ORDER = 0.02  # of a difference, by the steps below


def solved(actuator, distance, frequencies):
    moving = mesh_for(actuator, distance, frequencies[-1])
    probe = EddyProbe(actuator, moving, distance, ORDER)
    transfers, fields = probe.transfers(frequencies)
    return transfers.flux_linkage, fields, moving, probe.points.space


LOW, HIGH = (10.0, 100.0, 1000.0), (10.0, 300.0, 5000.0)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("text", "frequencies", "mesh_noise"),
    [(RINGED, LOW, MESH_NOISE), (POT_MAGNET, HIGH, MESH_NOISE_HIGH)],
    ids=["ringed", "pot-magnet"],
)
def test_slopes_are_those_between_drawings(monkeypatch, text, frequencies, mesh_noise):
    actuator, f = actuator_from_toml(text), np.array(frequencies)
    share = np.reshape(mesh_noise, (-1, 1, 1))
    numbers = numbers_from_toml(text, harmonic=True)
    monkeypatch.setitem(drawn_numbers_module.STEP, "mm", 0.05)
    monkeypatch.setattr(drawn_numbers_module, "SHARE_STEP", 0.02)
    farther = {one.facts.key: one for one in numbers_from_toml(text, harmonic=True)}
    compared = 0
    distances = actuator.sweep.distances_m[1::2]
    for distance in distances:
        base, fields, moving, space = solved(actuator, distance, f)
        slopes = impedance_slopes(actuator, numbers, moving, space, distance, f, fields)
        for number, slope in zip(numbers, slopes, strict=True):
            far = farther[number.facts.key]
            larger, smaller = (solved(one, distance, f)[0] for one in (far.larger, far.smaller))
            change, expected = slope * 2.0 * far.step, larger - smaller
            # Another material is on the same mesh
            noise = np.abs(base) * (1e-8 if number.facts.key.startswith("materials.") else share)
            assert np.all(np.abs(change - expected) < noise + SECOND_ORDER * np.abs(expected)), number.facts.key
            compared += bool(np.any(np.abs(expected) > 10.0 * noise))
    assert compared >= 8 * len(distances)  # most numbers change more than the meshes do


def test_mutual_slopes_are_symmetric_and_add_up_to_those_of_the_windings_in_series():
    currents = "current_A = { winding = [0, 1], further = [0, 1] }"
    lower, upper = "r_mm = [5.5, 9]\nz_mm = [-8.5, -5.5]", "r_mm = [5.5, 9]\nz_mm = [-5, -2]"
    further = f"[coils.further]\n{upper}\nturns = 110\nresistance_ohm = 2\n\n[moving.regions.disc]"
    text = RINGED.replace("r_mm = [5.5, 9]\nz_mm = [-8.5, -2]", lower).replace("[moving.regions.disc]", further)
    text = text.replace("current_A = [-1, 0, 1]", currents)
    drawn, f, d = numbers_from_toml(text, harmonic=True), np.array([50.0, 500.0]), 0.0015
    apart, numbers = _apart(actuator_from_toml(text)), _each(drawn, _apart)
    series = _in_series(apart)
    inductance, fields, moving, space = solved(apart, d, f)
    slopes = impedance_slopes(apart, numbers, moving, space, d, f, fields)
    assert slopes.shape == (len(numbers), 2, 2, 2)
    np.testing.assert_array_equal(slopes, slopes.swapaxes(2, 3))
    in_series, both = _each(drawn, _in_series), fields.sum(axis=1, keepdims=True)
    together = impedance_slopes(series, in_series, moving, space, d, f, both)[:, :, 0, 0]
    size = np.abs(inductance).max()
    np.testing.assert_allclose(slopes.sum(axis=(2, 3)), together, atol=1e-10 * size)


def _each(numbers, change):
    return tuple(replace(one, larger=change(one.larger), smaller=change(one.smaller)) for one in numbers)


def _apart(actuator):
    coils = tuple(replace(one, circuit=one.name) for one in actuator.coils)
    return replace(actuator, coils=coils, circuits=tuple(replace(actuator.circuits[0], name=c.name) for c in coils))


def _in_series(actuator):
    coils = tuple(replace(one, circuit="all") for one in actuator.coils)
    return replace(actuator, coils=coils, circuits=(replace(actuator.circuits[0], name="all"),))
