"""Impedance campaigns of a model, as an LCR meter reads them at distances, bias currents and frequencies."""

import casadi as ca
import numpy as np
import pandas as pd
from casadi import SX

from femfit.core.graph import GraphFunction, building
from femfit.effects.conditions import Conditions
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement_file import read_measurement

FREQUENCIES = np.geomspace(20.0, 10e3, 10)


def noisy(z, share, generator):
    """Impedances with errors of a share of each magnitude."""
    return z * (1.0 + share * (generator.standard_normal(len(z)) + 1j * generator.standard_normal(len(z))))


def impedance_file(
    model, path, effects=(), *, seed=1, share=1e-3, runs=2, distances=5, biases=3, frequencies=FREQUENCIES
):
    """A table of magnitude and phase; both errors are a share of the magnitude, of a run and of each reading."""
    generator = np.random.default_rng(seed)
    box = model.validity
    distance = np.linspace(1.02 * box.distance_min_m, 0.98 * box.distance_max_m, distances)
    bias = np.linspace(box.current_min_A, box.current_max_A, biases)
    grid = np.meshgrid(np.arange(runs), distance, bias, frequencies, indexing="ij")
    run, d, i, f = (one.ravel() for one in grid)
    at = Conditions(nominal_of(model), frequency_Hz=f)
    read = predict_readings(model, d, i, at, effects, ("inductance_H", "resistance_ohm"))
    z = read["resistance_ohm"] + 2j * np.pi * f * read["inductance_H"]
    z = noisy(z, share, generator)
    columns = {"run": run + 1, "gap [mm]": 1e3 * d, "Bias [A]": i, "f [kHz]": f / 1e3, "|Z|": np.abs(z)}
    pd.DataFrame(columns | {"theta [deg]": np.degrees(np.angle(z))}).to_csv(path, index=False)
    return path


def impedance_table(model, path, effects=(), **options):
    """The same, read."""
    return read_measurement(impedance_file(model, path, effects, **options))


def changed_impedance(change, distance, current, frequency, parameters):
    """What a number of a drawing adds to an impedance at points (N,), of shape (N, ...) as the number's change."""
    with building():
        x = SX.sym("x", 3)
        entries = change(x[0], x[1], x[2], None, parameters).ravel()
        function = GraphFunction([x], ca.vertcat(*(z.real for z in entries), *(z.imag for z in entries)))
    real, imag = np.split(function(np.stack([distance, current, frequency])), 2)
    return (real + 1j * imag).T.reshape(len(distance), *change.real_H.shape[3:])
