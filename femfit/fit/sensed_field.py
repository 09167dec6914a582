"""A field at a sensor, or a pickup coil's flux linkage, of a sweep: fitted over the distance and all currents.

In a device that does not saturate the value is a line in each current at every distance, S_0(d) + sum i_k S_k(d), which
needs no grid. Else each current takes a spline with as many functions as there are swept currents.

The Hall characteristic of one circuit: magnet part and coil part of the field at the Hall element.

B(d, i) = MH(d) + CH(d) i (+ CH_2(d) i^2 where distances left out ask for it), each a spline in a coordinate u(d).

The flux linkages of a sweep's pickup coils, fitted one by one.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 11.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import PICKUP_COLUMN
from femfit.fit import constants
from femfit.fit.basis import CoenergyBasis, CurrentSplines, clamped_knots, lines_by_current, misfit_by_currents
from femfit.fit.coenergy_choice import smallest, splines_along
from femfit.fit.coenergy_system import Channel, CoenergySystem
from femfit.fit.rows import FitRows, rms
from femfit.model.bspline import TensorSpline
from femfit.model.hall import CurrentAxis, HallSpline, SensedField
from femfit.tables.sweep_table import SweepTable, current_names


@dataclass(frozen=True, eq=False)
class SensedFit:
    """A fitted field and its error with distances left out, over the range of the values."""

    field: SensedField
    held_out: float
    rms: float


def fit_sensed(distance: FloatArray, currents: FloatArray, values: FloatArray, what: str) -> SensedFit:
    """Fit values (N,) at distances (N,) and currents (N, n); ``what`` names them in an error.

    Raises
    ------
    FitError
        If there are too few currents, or the rows do not determine the fit.
    """
    axes = [np.unique(column) for column in currents.T]
    constant = [name for name, axis in enumerate(axes, 1) if len(axis) < 2]
    if constant:
        raise FitError(
            f"{what} needs two currents or more of each circuit; circuit {constant[0]} has one. Sweep another."
        )
    lines, scale = lines_by_current([axis[[0, -1]] for axis in axes]), float(np.ptp(values)) or 1.0
    missed = rms(misfit_by_currents(lines.columns(currents), values, distance)) / scale
    # Noisy rows off a grid determine no splines; lines that miss little are then what they tell
    trials = [
        *([lines] if missed < constants.COARSE["force"] else []),
        *([_splines(axes)] if missed > constants.HELD_OUT_TARGET else []),
    ]
    basis, coefficients, error = _fitted(distance, currents, values, trials, constants.HELD_OUT_TARGET, what)
    functions = basis.functions
    axes_of = tuple(map(CurrentAxis, functions.knots, functions.degrees))
    field = SensedField(basis.coordinate, basis.u_knots, basis.u_degree, axes_of, functions.table(coefficients))
    return SensedFit(field, error, rms(field.field(distance, currents) - values))


def sensed_or_why(distance: FloatArray, currents: FloatArray, values: FloatArray, what: str) -> SensedFit | str:
    """What :func:`fit_sensed` fits, or why it cannot."""
    try:
        return fit_sensed(distance, currents, values, what)
    except FitError as error:
        return str(error)


def _splines(axes: list[FloatArray]) -> CurrentSplines:
    """Interpolating splines, whose knots lie at currents but the outermost ones."""
    degrees = tuple(min(constants.CURRENT_DEGREE, len(axis) - 1) for axis in axes)
    knots = []
    for axis, degree in zip(axes, degrees, strict=True):
        inner = axis[2:-2] if degree == constants.CURRENT_DEGREE else axis[:0]
        knots.append(clamped_knots(np.concatenate([axis[:1], inner, axis[-1:]]), degree))
    return CurrentSplines(tuple(knots), degrees)


def _fitted(
    distance: FloatArray,
    currents: FloatArray,
    values: FloatArray,
    trials: Sequence[CurrentSplines],
    target: float,
    what: str,
) -> tuple[CoenergyBasis, FloatArray, float]:
    """The functions that distances left out ask for, their coefficients, and the error there over the values' range."""
    distances = np.unique(distance)
    scale = np.full(len(values), float(np.ptp(values)) or 1.0)
    inner, channel = distances[1:-1], Channel((), np.arange(len(values)), values, scale, scale)
    every = min(constants.DISTANCE_FOLDS, len(inner))
    folds = [np.isin(distance, inner[k::every]) for k in range(every)]
    system = CoenergySystem(distance, currents, (channel,), folds)
    # One distance left out must leave as many as there are functions
    degree = min(constants.U_DEGREE, len(distances) - 2)
    groups = chain.from_iterable(
        splines_along(distances, constants.CIRCUIT_CELLS, functions, degree=degree, breaks="geometric")
        for functions in trials
    )
    basis, error = smallest(groups, system.held_out_errors, target)
    projection = system.projection(basis)
    if projection is None:
        raise FitError(
            f"{what}: the rows do not determine it. Sweep each circuit's current by itself, or every combination of "
            "them where the iron saturates."
        )
    return basis, projection.coefficients.reshape(basis.shape), error


@dataclass(frozen=True, eq=False)
class HallFit:
    """A fitted Hall characteristic."""

    data = (
        *("rms_T", "max_T", "coil_slope_T_per_A", "magnet_field_T", "held_out_of_range=held_out"),
        "coefficients=field.spline.coefficients.size",
    )

    field: HallSpline
    basis: CoenergyBasis
    rms_T: float
    max_T: float
    held_out: float  # Rms error on held-out rows over the field's range
    # Least and largest dB/di over the sweep; their difference is the magnet's own permeability
    coil_slope_T_per_A: tuple[float, float]
    magnet_field_T: tuple[float, float]  # B without current at the largest and the least distance


def fit_hall(rows: FitRows, hall: FloatArray) -> HallFit:
    """Fit the field B_z (n,) in T at the Hall element, at two currents or more, or without any."""
    several = len(rows.currents) > 1
    ends = rows.currents[[0, -1]] if several else [0.0, 1.0]
    degrees = range(1, min(3, len(rows.currents) - 1) + 1) if several else [0]
    trials = [CurrentSplines((np.repeat(ends, degree + 1),), (degree,)) for degree in degrees]
    what, (distance, currents) = "The field at the Hall element", (rows.distance, rows.circuit_currents)
    basis, coefficients, held_out = _fitted(distance, currents, hall, trials, constants.HALL_TARGET, what)
    (knots,), (degree,) = basis.functions.knots, basis.functions.degrees
    field = HallSpline(basis.coordinate, TensorSpline(basis.u_knots, knots, basis.u_degree, degree, coefficients))
    fitted, _, slope = field.derivatives(distance, currents)
    magnet = field.field(rows.distances[[-1, 0]], np.zeros((2, 1)))
    return HallFit(
        field=field,
        basis=basis,
        rms_T=rms(fitted - hall),
        max_T=float(np.max(np.abs(fitted - hall))),
        held_out=held_out,
        coil_slope_T_per_A=(float(slope.min()), float(slope.max())),
        magnet_field_T=(float(magnet[0]), float(magnet[1])),
    )


def fit_pickups(table: SweepTable) -> dict[str, SensedFit | str]:
    """The flux linkage of each pickup coil of a table by the coil's name, or why it could not be fitted."""
    rows, fits = table.valid_rows(), dict[str, SensedFit | str]()
    currents = rows[current_names(rows)].to_numpy(dtype=float)
    if not currents.any():  # a pair of magnets, or one current of zero: nothing to fit along
        currents = currents[:, :0]
    distance = rows["distance_m"].to_numpy(dtype=float)
    for match in filter(None, map(PICKUP_COLUMN.fullmatch, map(str, rows.columns))):
        values = rows[match[0]].to_numpy(dtype=float)
        fits[match[1]] = sensed_or_why(distance, currents, values, f"Pickup coil {match[1]!r}")
    return fits
