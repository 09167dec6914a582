"""A coil cut in two: the same device once more, as one of two circuits that carry the same current.

Each half has half of the turns, of the resistance and of the driver's voltage. With the flux linkage of one circuit
M_01 + L i, those of the halves are M_01 / 2 + (L / 4 + s) i_1 + (L / 4 - s) i_2 with what strays between them, s. Fed
alike, both carry the current of the whole, and whatever femfit says of the one must hold for the other.
"""

from dataclasses import replace

import numpy as np

from femfit.model.actuator_model import ActuatorModel
from femfit.model.several_magnetics import CoenergyMatrix

NAMES = ("inner", "outer")
STRAY_H = 1e-3


def halves_with_eddies(model: ActuatorModel) -> ActuatorModel:
    """The halves of a model with eddy currents: a pattern acts like the current C in both, as in the whole.

    With L_ij of the halves, L_i1 C + L_i2 C is the half L C / 2 of what the pattern links with the whole.
    """
    halves, eddy = cut_in_two(model), model.eddy
    return replace(halves, eddy=replace(eddy, circuits=NAMES, couplings=np.repeat(eddy.couplings, 2, axis=1)))


def cut_in_two(model: ActuatorModel) -> ActuatorModel:
    """The halves of a model whose co-energy is one polynomial of second degree in the current."""
    spline, circuit, box = model.magnetics.spline, model.require_circuit(), model.validity
    low, high = spline.y_knots[[0, -1]]
    first, middle, last = spline.coefficients.T  # of Bernstein's polynomials over low to high
    slope, inductance = 2.0 * (middle - first) / (high - low), 2.0 * (last - 2.0 * middle + first) / (high - low) ** 2
    alone, flux = 2.0 * (first - low * slope + 0.5 * low**2 * inductance), slope - low * inductance
    own, mutual = 0.25 * inductance + STRAY_H, 0.25 * inductance - STRAY_H
    drop = circuit.drive.diode_V
    half = replace(
        circuit,
        resistance_ohm=0.5 * circuit.resistance_ohm,
        voltage_min_V=0.5 * circuit.voltage_min_V,
        voltage_max_V=0.5 * circuit.voltage_max_V,
        inductance_H=0.5 * circuit.inductance_H,
        drive=replace(circuit.drive, diode_V=None if drop is None else 0.5 * drop),
    )
    return replace(
        model,
        magnetics=CoenergyMatrix(
            NAMES,
            model.magnetics.coordinate,
            spline.x_knots,
            spline.x_degree,
            np.stack([alone, 0.5 * flux, 0.5 * flux, own, mutual, own], axis=1),
        ),
        validity=replace(box, current_limits_A=np.repeat(box.current_limits_A, 2, axis=0)),
        circuits=tuple(replace(half, name=name) for name in NAMES),
        sensor=None,
    )
