"""Impedances of a model as an LCR meter reads them, and of a conductivity as a number of the drawing."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pandas as pd
from casadi import SX

from femfit.core.graph import GraphFunction, building
from femfit.effects.conditions import Conditions
from femfit.effects.effect import EffectPoint
from femfit.model.bspline import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.impedance import impedance_change
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement_file import read_measurement
from support.eddies import with_eddies

FREQUENCIES = np.geomspace(20.0, 10e3, 10)


def noisy(z, share, generator):
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
    return read_measurement(impedance_file(model, path, effects, **options))


def changed_impedance(change, distance, current, frequency, parameters):
    """What a number of a drawing adds to an impedance at points (N,), of shape (N, ...) as the number's change."""
    with building():
        x = SX.sym("x", 3)
        entries = change(x[2], EffectPoint(x[0], x[1], None, parameters)).ravel()
        function = GraphFunction([x], ca.vertcat(*(z.real for z in entries), *(z.imag for z in entries)))
    real, imag = np.split(function(np.stack([distance, current, frequency])), 2)
    return (real + 1j * imag).T.reshape(len(distance), *change.real_H.shape[3:])


KEY = "materials.core.conductivity_MS_per_m"
STEP = 1e-4


def with_conductivity(model, share):
    """The model with eddy currents whose conducting parts conduct better by a share: resistances go with 1 / sigma."""
    eddied = with_eddies(model)
    return replace(eddied, eddy=replace(eddied.eddy, resistances_ohm=eddied.eddy.resistances_ohm / (1.0 + share)))


def with_drawn_conductivity(model, tolerance=0.1):
    """The model with eddy currents, and its conductivity among the drawing's numbers: slopes by central differences."""
    box = model.validity
    d = np.linspace(box.distance_min_m, box.distance_max_m, 7)
    f = np.geomspace(10.0, 20e3, 34)
    i = np.array([box.current_min_A, box.current_max_A])
    grid = np.meshgrid(d, i, f, indexing="ij")
    larger, smaller = (with_conductivity(model, s).impedance(*grid) for s in (STEP, -STEP))
    slope = (larger - smaller) / (2.0 * STEP)
    change = impedance_change("change", DistanceCoordinate(0.03), d, i, f, slope, share=True)
    drawn = DrawnEffect(KEY, "the conductivity of core", "", 6.0, tolerance, impedance=change)
    return replace(with_eddies(model), drawn=(drawn,))
