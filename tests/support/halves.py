"""A coil cut in two: the same device once more, as one of two circuits that carry the same current.

Each half has half of the turns, of the resistance and of the driver's voltage. With the flux linkage of one circuit
M_01 + L i, those of the halves are M_01 / 2 + (L / 4 + s) i_1 + (L / 4 - s) i_2 with what strays between them, s. Fed
alike, both carry the current of the whole, and whatever femfit says of the one must hold for the other.
"""

from dataclasses import replace

import numpy as np

from femfit.model.actuator_model import ActuatorModel
from femfit.model.coenergy_matrix import CoenergyMatrix

NAMES = ("inner", "outer")
STRAY_H = 1e-3


def cut_in_two(model: ActuatorModel) -> ActuatorModel:
    """The halves of a model whose co-energy is one polynomial of second degree in a current from zero on."""
    spline, circuit, box = model.magnetics.spline, model.require_circuit(), model.validity
    largest = spline.y_knots[-1]
    still, middle, end = spline.coefficients.T
    alone, flux = 2.0 * still, 2.0 * (middle - still) / largest
    inductance = 2.0 * (end - 2.0 * middle + still) / largest**2
    own, mutual = 0.25 * inductance + STRAY_H, 0.25 * inductance - STRAY_H
    half = replace(
        circuit,
        resistance_ohm=0.5 * circuit.resistance_ohm,
        voltage_min_V=0.5 * circuit.voltage_min_V,
        voltage_max_V=0.5 * circuit.voltage_max_V,
        inductance_H=0.5 * circuit.inductance_H,
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
        validity=replace(box, further_A=((box.current_min_A, box.current_max_A),)),
        circuit=replace(half, name=NAMES[0]),
        further_circuits=(replace(half, name=NAMES[1]),),
        sensor=None,
    )
