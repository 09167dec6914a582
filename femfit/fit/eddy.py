r"""A model's eddy currents from those of a sweep: fewer combinations of its patterns, and splines over the distance.

With the inductances L of the circuits, m of circuits with patterns and N among patterns, the flux linkages phi and
lambda of both without any current, the model's co-energy (:mod:`femfit.model.eddy_currents`) has

    C = L^-1 m,    lambda - C^T phi,    Q = N - m^T L^-1 m.

The field gives all of them with their slopes over the distance, M' = -2 force, and the splines follow both.
"""

from collections.abc import Collection
from dataclasses import replace

import casadi as ca
import numpy as np
from casadi import SX
from scipy.interpolate import PchipInterpolator, make_interp_spline

from femfit.core.errors import FitError
from femfit.core.graph import GraphFunction, building
from femfit.core.numerics import FloatArray
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.tolerances import KINDS
from femfit.fit.constants import EDDY_BETWEEN, EDDY_DEGREE, EDDY_FREQUENCIES, EDDY_LOWEST_HZ
from femfit.fit.drawing import CONDUCTIVITY, drawn_effect, spline_frequencies, with_impedances
from femfit.fit.eddy_states import StateChoice
from femfit.laws.law import STEP
from femfit.model.actuator_model import ActuatorModel
from femfit.model.bspline import DistanceCoordinate, basis_matrix
from femfit.model.drawn_effect import DrawnEffect, parameter_name
from femfit.model.eddy_currents import EddyBias, EddyCurrents, EddyError
from femfit.model.impedance import impedance_change
from femfit.model.magnetics import Magnetics
from femfit.tables.eddy_table import EddyTable
from femfit.tables.sweep_table import SweepTable


def fit_eddy(
    table: EddyTable | None, magnetics: Magnetics, error: float | None = None, saturating: Collection[str] = ()
) -> EddyCurrents | None:
    """The eddy currents to an error, the drawing's own where none is given; None where nothing conducts.

    Parameters
    ----------
    saturating : collection of str
        Names of the drawing's materials that saturate.

    Raises
    ------
    FitError
        If there is one distance alone, or the splines are not passive between two.
    """
    if table is None:
        return None
    if len(table.distances_m) == 1:
        raise FitError(
            f"The eddy currents of a model need two distances or more; they were solved at "
            f"{1e3 * table.distances_m[0]:.4g} mm alone. Sweep more distances."
        )
    low, high = np.maximum(table.frequencies_Hz[[0, -1]], EDDY_LOWEST_HZ)
    frequencies = np.geomspace(low, high, EDDY_FREQUENCIES)
    combined = StateChoice(table, frequencies).table(error or table.asked_error)
    middle = len(table.distances_m) // 2
    n = len(table.circuits)
    _, modes = np.linalg.eigh(-combined.flux_linkage[middle, n:, 1 + n :])  # the slowest first
    combined = combined.combined(modes)
    coordinate = getattr(magnetics, "coordinate", None) or DistanceCoordinate(
        float(np.ptp(table.distances_m)), kind="distance"
    )
    eddy = _through(combined, coordinate)
    _require_passive(eddy, table.distances_m)
    # Of the field itself, and of the model beside it
    braking = np.array([0.0, np.nan_to_num(table.braking_error), 0.0])
    of_field = table.error_at(frequencies) if n else braking
    at_distances = (_departures(as_table(eddy, table), table, frequencies) + of_field).max(axis=(0, 1))
    errors = at_distances + _between(eddy, combined, frequencies)
    stated = EddyError(
        float(frequencies[0]),
        float(frequencies[-1]),
        impedance=float(errors[0]) if n else None,
        force=float(errors[1]),
        hall=float(errors[2]) if n and table.hall is not None else None,
        **_static_errors(table, magnetics),
    )
    bias = None
    if table.bias_A is not None and n:
        order, which = np.argsort(table.distances_m), tuple(name for name in table.materials if name in saturating)
        bias = EddyBias(table.distances_m[order], table.bias_A[order], which)
    return replace(eddy, error=stated, bias=bias)


def with_eddy_currents(model: ActuatorModel, table: SweepTable) -> ActuatorModel:
    """The model with a sweep's eddy currents, and what the numbers of the drawing change of its impedances."""
    eddy = fit_eddy(table.eddy, model.magnetics, saturating=table.saturating)
    drawn = with_impedances(model.drawn, table.impedance_slopes, model.magnetics, eddy)
    return replace(model, eddy=eddy, drawn=(*drawn, *conductivities(table.eddy, eddy)))


def _through(table: EddyTable, coordinate: DistanceCoordinate) -> EddyCurrents:
    """Splines of the table's own patterns, through what the field gives at its distances."""
    knots, coefficients = _splines(coordinate, table.distances_m, *_entries(table))
    n, r = len(table.circuits), table.patterns
    parts = np.split(coefficients, np.cumsum([n * r, r, r * (r + 1) // 2]), axis=1)
    return EddyCurrents(
        names=tuple(f"eddy_{k + 1}" for k in range(r)),
        resistances_ohm=np.ones(r),
        circuits=table.circuits,
        coordinate=coordinate,
        u_knots=knots,
        u_degree=EDDY_DEGREE,
        couplings=parts[0].reshape(len(coefficients), n, r),
        flux_linkages_Wb=parts[1],
        inductances_H=parts[2],
        hall_T_per_A=None if table.hall is None else parts[3],
    )


def conductivities(table: EddyTable | None, eddy: EddyCurrents | None) -> tuple[DrawnEffect, ...]:
    """The conductivities of the drawing's materials, with what they change of the circuits' impedances.

    That of all that conducts changes how fast the eddy currents decay, and the impedance as what the field says more.
    """
    if table is None or eddy is None or not table.circuits:
        return ()
    of_model = (
        replace(as_table(eddy, table), resistances=np.eye(eddy.count)[None]) if len(table.materials) == 1 else None
    )
    frequencies = spline_frequencies(table.checked_Hz)
    effects = []
    for j in range(len(table.materials)):
        places = range(len(table.distances_m))
        changes = np.array([table.conductivity_changes(j, k, frequencies) for k in places])
        if of_model is not None:
            changes -= [of_model.conductivity_changes(0, k, frequencies) for k in places]
        slope, bend = changes.swapaxes(0, 1)
        change = impedance_change(
            parameter_name(""),
            eddy.coordinate,
            table.distances_m,
            np.zeros(1) if table.bias_A is None else table.bias_A[:, :1].mean(axis=0),
            frequencies,
            slope[:, None],
            share=True,
            bend=bend[:, None],
        )
        key, drawn = f"materials.{table.materials[j]}.conductivity_MS_per_m", 1e-6 * table.conductivities_S_per_m[j]
        number = NumberFacts(key, (), CONDUCTIVITY, float(drawn), "", KINDS[CONDUCTIVITY].tolerance)
        effects.append(replace(drawn_effect(number, ()), impedance=change, conducts=of_model is not None))
    return tuple(effects)


def _entries(table: EddyTable) -> tuple[FloatArray, FloatArray]:
    """C, lambda, Q and h of each distance in a row, and their slopes in 1/m; those that are not known are NaN.

    They are those of h, and all of an actuator that saturates. The others are the imaginary part of what a tiny
    imaginary way gives, exact to rounding (Squire and Trapp, SIAM Rev. 40 (1998) 110).

    Beside iron that saturates the patterns of a single circuit link the flux of the currents C that they act like, from
    rest to the bias; small currents alone, and C = L^-1 m, do not tell what they link there.
    """
    c, count = len(table.circuits), len(table.distances_m)
    flux = table.flux_linkage - 2j * STEP * table.force[:, 1:]
    at_rest = flux[:, :, 0] if table.rest is None else table.rest
    windings, between, among = flux[:, :c, 1 : 1 + c], flux[:, :c, 1 + c :], flux[:, c:, 1 + c :]
    coupling = np.linalg.solve(windings, between)
    if c == 1 and table.bias_A is not None and table.rest is not None:
        biased = np.flatnonzero(table.bias_A.any(axis=1))
        linked = (flux[:, :, 0] - at_rest)[biased]
        coupling[biased, 0] = linked[:, 1:] / linked[:, :1]
    turned = coupling.swapaxes(1, 2)
    crossed, (first, second) = between.swapaxes(1, 2) @ coupling, np.triu_indices(table.patterns)
    inductance = among - crossed - crossed.swapaxes(1, 2) + turned @ windings @ coupling
    linking = at_rest[:, c:] - (turned @ at_rest[:, :c, None])[:, :, 0]
    entries = [coupling.reshape(count, -1), linking, inductance[:, first, second]]
    if table.hall is not None:
        hall = table.hall[:, 1 + c :] - (turned @ table.hall[:, 1 : 1 + c, None])[:, :, 0]
        entries.append(hall)
    values = np.concatenate(entries, axis=1)
    slopes, sloped = values.imag / STEP, sum(entry.shape[1] for entry in entries[:3])
    slopes[:, sloped if table.bias_A is None else 0 :] = np.nan
    return values.real, slopes


def _splines(
    coordinate: DistanceCoordinate, distances: FloatArray, values: FloatArray, slopes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Knots and coefficients (N, entries) of splines through values (D, entries) with these slopes.

    Cubic between two distances (Hermite); a slope that is not known is that of the cubic spline through the values.
    Where none is known, beside iron that saturates, the values bend with the bias, which differs from distance to
    distance: a cubic spline would swing there, even to negative inductances. The monotone slopes of Fritsch and
    Butland (SIAM J. Sci. Stat. Comput. 5 (1984) 300) do not.
    """
    u, du, _ = coordinate.with_slopes(distances)
    order = np.argsort(u)
    u, values, slopes = u[order], values[order], slopes[order] / du[order, None]
    unknown = ~np.isfinite(slopes).all(axis=0)
    through = (
        PchipInterpolator(u, values)
        if unknown.all()
        else make_interp_spline(u, values[:, unknown], k=min(3, len(u) - 1))
    )
    slopes[:, unknown] = through.derivative()(u)
    knots = np.sort(np.concatenate([u, u, u[[0, 0, -1, -1]]]))
    step = np.gradient(u)[:, None]
    rows = np.concatenate([basis_matrix(u, knots, EDDY_DEGREE), step * basis_matrix(u, knots, EDDY_DEGREE, 1)])
    return knots, np.linalg.solve(rows, np.concatenate([values, step * slopes]))


def _require_passive(eddy: EddyCurrents, distances: FloatArray) -> None:
    share = np.linspace(0.0, 1.0, EDDY_BETWEEN, endpoint=False)[:, None]
    fine = np.append(distances[:-1] + share * np.diff(distances), distances[-1])
    smallest = np.linalg.eigvalsh(eddy.forms(fine)[0].inductance)[:, 0]
    if smallest.min() <= 0.0:
        millimetres = 1e3 * fine[np.argmin(smallest)]
        raise FitError(
            f"The eddy currents' inductances are not positive at {millimetres:.3g} mm, between the sweep's distances. "
            "Sweep more distances there."
        )


def _between(eddy: EddyCurrents, table: EddyTable, frequencies: FloatArray) -> FloatArray:
    """How far the splines may be off between the distances, (3,) as departures; nothing of two distances alone.

    It is a part of what they change by half-way to a distance's neighbours if the distance is left out: of splines of
    the order 2 p, a cell of width a beside one of width b then misses (1 + 2 b / a)^p times what it missed before.
    Splines through values and slopes have p = 2, those through values alone p = 1. This is good for a factor
    of about two.
    """
    count, worst = len(table.distances_m), np.zeros(3)
    for k in range(1, count - 1):
        fewer = _through(table.at(np.delete(np.arange(count), k)), eddy.coordinate)
        near = table.distances_m[[k - 1, k, k + 1]]
        width = np.abs(np.diff(eddy.coordinate.with_slopes(near)[0]))
        ratio = 1.0 / ((1.0 + 2.0 * width[::-1] / width) ** (2 if table.bias_A is None else 1) - 1.0)
        beside = replace(table.at(np.array([k, k])), distances_m=0.5 * (near[1:] + near[:-1]))
        off = _departures(as_table(fewer, beside), as_table(eddy, beside), frequencies)
        worst = np.maximum(worst, (ratio[:, None, None] * off).max(axis=(0, 1)))
    return worst


def _departures(model: EddyTable, table: EddyTable, frequencies: FloatArray) -> FloatArray:
    """Of impedance, force and Hall field at each distance and frequency, relative, shape (d, f, 3).

    Without circuits there is in place of the force the power that slow motion loses beside the magnets, (d, 1, 3).
    """
    if table.circuits:
        places = range(len(table.distances_m))
        return np.array([model.transfers(k, frequencies).departures(table.transfers(k, frequencies)) for k in places])
    power, exact = ((patterns.force[:, 0, 1:] ** 2).sum(axis=1) for patterns in (model, table))
    off = np.divide(np.abs(power - exact), exact, out=np.zeros_like(exact), where=exact > 0.0)
    return np.asarray(off[:, None, None] * np.array([0.0, 1.0, 0.0]))


def _static_errors(table: EddyTable, magnetics: Magnetics) -> dict[str, float]:
    """The static model's at the currents about which the field was solved; nothing where it is linear."""
    if table.bias_A is None or not table.circuits:
        return {}
    state, n = magnetics.state(table.distances_m, table.bias_A), len(table.circuits)
    pairs = (
        ("static_inductance", state.inductance, table.flux_linkage[:, :n, 1 : 1 + n]),
        ("static_force", state.motional_constant, 2.0 * table.force[:, 0, 1 : 1 + n]),
    )
    return {name: float(np.abs(model - field).max() / np.abs(field).max()) for name, model, field in pairs}


def as_table(eddy: EddyCurrents, table: EddyTable) -> EddyTable:
    """What a sweep's table would be if the field were as the splines say, with the circuits' part as it is there."""
    c, m, count = len(table.circuits), len(table.circuits) + eddy.count, len(table.distances_m)
    with building():
        d, w, x = SX.sym("d"), SX.sym("w", m), SX.sym("x", c, 3 + 2 * c)
        form, rise, of_circuits = ca.horzsplit(x, [0, 1 + c, 2 + 2 * c, 3 + 2 * c])
        energy = eddy.expression(lambda _, u: ca.dot(u, form @ ca.vertcat(1.0, 0.5 * u)), d, w)
        linkage = ca.gradient(energy, w)
        flux = ca.vec(ca.horzcat(linkage, ca.jacobian(linkage, w)))
        seen = ca.gradient(eddy.field(lambda _, u: ca.dot(of_circuits, u), d, w), w)
        changed = ca.jtimes(flux, ca.vertcat(d, ca.vec(form)), ca.vertcat(1.0, ca.vec(rise)))
        values = ca.substitute(ca.vertcat(flux, changed, seen), w, SX.zeros(m))
        function = GraphFunction([d, ca.vec(x)], values)
    hall = np.zeros((count, 1 + c)) if table.hall is None else table.hall
    of_table = table.flux_linkage[:, :c, : 1 + c], -2.0 * table.force[:, 1 : 1 + c, : 1 + c], hall[:, 1 : 1 + c, None]
    evaluated = function(table.distances_m[None], np.concatenate(of_table, axis=2).T.reshape(-1, count))
    linked, pull = (part.reshape(1 + m, m, count).T for part in np.split(evaluated[:-m], 2))
    force = np.zeros((count, 1 + m, 1 + m))
    force[:, 0, 0] = table.force[:, 0, 0]
    force[:, 1:, 0] = force[:, 0, 1:] = -0.5 * pull[:, :, 0]
    if table.bias_A is None:  # else the field does not tell what is of second order, either
        force[:, 1:, 1:] = -0.5 * pull[:, :, 1:]
    at_hall = None if table.hall is None else np.concatenate([hall[:, :1], evaluated[-m:].T], axis=1)
    return replace(table, force=force, flux_linkage=linked, hall=at_hall)
