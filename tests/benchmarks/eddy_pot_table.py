"""A pot magnet's impedance and force of an ampere, by the model and by direct solutions one order finer.

``python tests/benchmarks/eddy_pot_table.py geometry/pot-magnet.toml -o runs/pot-magnet`` sweeps the drawing, fits its
model and prints a line a distance and frequency as Markdown, as docs/howto/predict_eddy_currents.md has them. The
distances lie within the sweep; each direct solution has a mesh of its own.
"""

import argparse
from pathlib import Path

import numpy as np

import femfit as ff
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.field.layout import layout_of
from femfit.field.moving_mesh import MovingMesh
from femfit.field.settings import SolverSettings

DISTANCES_MM = (0.75, 1.75, 4.0)
FREQUENCIES_HZ = np.array([1.0, 10.0, 100.0, 1e3, 1e4])


def main():
    """Sweep, fit and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drawing", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    ff.run_sweep(given.drawing, given.output)
    actuator, model = ff.read_actuator(given.drawing), ff.fit_model(given.output).model
    settings = SolverSettings(order=ORDER + 1, skin_frequency_Hz=float(FREQUENCIES_HZ[-1]))
    layout = layout_of(actuator, settings)
    print(f"{model.eddy.count} states\n")
    print("| distance | frequency | resistance | inductance | off | force of an ampere at 1 A | off |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    for distance in 1e-3 * np.array(DISTANCES_MM):
        moving = MovingMesh(actuator, (distance,), layout, settings)
        found, _ = EddyProbe(actuator, moving, distance, settings.order).transfers(FREQUENCIES_HZ)
        for frequency, linked, forces in zip(FREQUENCIES_HZ, found.flux_linkage, found.force, strict=True):
            impedance = model.circuits[0].resistance_ohm + 2j * np.pi * frequency * linked[0, 0]
            force = forces[0, 0] + forces[1, 0]
            off = abs(complex(model.impedance(distance, 1.0, frequency)) / impedance - 1.0)
            force_off = abs(complex(np.ravel(model.force_transfer(distance, 1.0, frequency))[0]) / force - 1.0)
            print(
                f"| {1e3 * distance:g} mm | {frequency:g} Hz | {impedance.real:.4g} ohm "
                f"| {1e3 * impedance.imag / (2.0 * np.pi * frequency):.4g} mH | {off:.2%} "
                f"| {abs(force):.4g} N/A, {np.degrees(np.angle(force)):.1f}° | {force_off:.2%} |"
            )


if __name__ == "__main__":
    main()
