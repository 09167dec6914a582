"""A winding's field behind a resistance in implicit time steps: what reduced models of eddy currents stand for."""

import math
from functools import cache
from tempfile import TemporaryDirectory

import numpy as np
from ngsolve import H1, BilinearForm

import femfit as ff
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_sweep import ORDER
from femfit.field.harmonic import HarmonicSystem, add_eddy_form, conductors
from femfit.field.layout import layout_of
from femfit.field.material_points import MaterialPoints
from femfit.field.moving_mesh import MovingMesh
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import csr, materials, source_loads
from support.small_drawing import POT

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
"""Of Alexander's two implicit stages of the second order, L-stable (SIAM J. Numer. Anal. 14 (1977) 1006)."""


def step_of_windings(inductances, resistances, volts, times):
    """The same of linked windings at rest, the first of which gets the volts: exact, by the modes of L^-1 R."""
    root = 1.0 / np.sqrt(resistances)
    delays, modes = np.linalg.eigh(root[:, None] * inductances * root)  # of di/dt = L^-1 (U - R i), made symmetric
    grown = 1.0 - np.exp(-times[:, None] / delays)
    currents = (grown * modes[0] * volts * root[0]) @ modes.T * root
    return currents[:, 0], currents @ inductances[0]


def mesh_for(actuator, distance, highest_Hz, order=ORDER):
    """A mesh with the moving part at a distance in m, whose elements resolve the skin at a frequency."""
    settings = SolverSettings(order=order, skin_frequency_Hz=highest_Hz)
    return MovingMesh(actuator, (distance,), layout_of(actuator, settings), settings)


def step_of_voltage(actuator, moving, volts, first, last, per_octave):
    """Times (t,) in s, current (t,) in A and flux linkage (t,) in Wb of one circuit, from rest, the body held.

    K w + M dw/dt = load i with volts = R i + load . dw/dt, both as one system E dy/dt = A y + f. A step of voltage has
    no time of its own: steps double from octave to octave of time, ``per_octave`` in each, from ``first`` to ``last``.
    """
    points = MaterialPoints(H1(moving.mesh, order=ORDER), materials(actuator))
    system = HarmonicSystem(moving, actuator, points, real=True)
    system.move()
    form = BilinearForm(system.space)
    add_eddy_form(form, conductors(actuator))
    mass = csr(form.Assemble().mat, system.space.ndof)
    load = source_loads(system.space, actuator)[0]
    resistance = actuator.circuits[0].resistance_ohm
    times, currents, linked = [0.0], [0.0], [0.0]
    held, flux, step = np.zeros(system.space.ndof), 0.0, first / per_octave  # M w and load . w
    while times[-1] < last * (1.0 - 1e-9):
        s = 1.0 / (GAMMA * step)
        (unit,) = system.solve(s, load[None])

        def stage(base, base_flux, s=s, unit=unit):
            """Current and field from what E y is before the stage's own rate."""
            (alone,) = system.solve(s, s * base[None]) if base.any() else (np.zeros_like(base),)
            current = (volts + s * (base_flux - load @ alone)) / (resistance + s * (load @ unit))
            return current, current * unit + alone

        for _ in range(per_octave):
            _, inner = stage(held, flux)
            share = (1.0 - GAMMA) / GAMMA
            current, field = stage(held + share * (mass @ inner - held), flux + share * (load @ inner - flux))
            held, flux = mass @ field, float(load @ field)
            times.append(times[-1] + step)
            currents.append(current)
            linked.append(flux)
        step = times[-1] / per_octave
    return np.array(times), np.array(currents), np.array(linked)


def departures(ours, exact):
    """Largest differences of currents and of flux linkages at any instant, over their final values."""
    return [float(np.abs(one - other).max() / abs(other[-1])) for one, other in zip(ours, exact, strict=True)]


@cache
def pot_step():
    """Of a pot's step from drawing to model: what halving the time steps changes, and how far off the model is.

    Largest differences of the current, the current and the flux linkage over their final values, between two distances
    of the sweep.
    """
    text = POT.replace("start = 10, stop = 1000, per_decade = 2", "start = 1, stop = 10000, per_decade = 1")
    text = text.replace("[1, 1.5, 2, 2.5]", "[1, 1.25, 1.5, 1.75, 2]")
    actuator = actuator_from_toml(text.replace("eddy_error = 0.02", "eddy_error = 0.01"))
    with TemporaryDirectory() as directory:
        model = ff.fit_model(ff.run_sweep(actuator, directory, workers=1)).model
    distance, size = 1.6e-3, 1 + model.eddy.count
    moving = mesh_for(actuator, distance, 16e3)
    coarse, fine = (step_of_voltage(actuator, moving, 1.0, 1e-5, 0.1, steps) for steps in (4, 8))
    inductances = model.windings.magnetics.inductance(np.array(distance), np.zeros(size))
    ours = step_of_windings(inductances, model.windings.resistances_ohm, 1.0, fine[0])
    return departures([coarse[1]], [fine[1][::2]]) + departures(ours, fine[1:])
