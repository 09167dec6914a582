"""Co-energy splines and laws in a model file."""

import math
from collections.abc import Sequence
from typing import Any

from femfit.core.numerics import FloatArray
from femfit.laws.catalogue import law_by_name
from femfit.model.bspline import PARABOLA, TensorSpline, is_clamped
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.hall import SensedField
from femfit.model.json_section import Section
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics, Magnetics
from femfit.model.network_magnetics import NetworkMagnetics
from femfit.model.several_magnetics import CoenergyMatrix, CoenergyTensor

INVERSE, PLAIN, TWO_GAPS = "inverse_distance", "distance", "two_gaps"
"""What u may be: d_0 / (d + s), d / d_0, or, of several circuits, sinh((d - d_0) / h)."""

NETWORK_KIND, MATRIX_KIND, TENSOR_KIND = "reluctance_network", "coenergy_matrix", "coenergy_tensor"

COORDINATE_KEYS = ("coordinate", "reference_distance_m", "distance_shift_m", "stretch_m")
_SPLINE_KEYS = "kind", *COORDINATE_KEYS, "u_knots", "current_knots_A", "u_degree", "current_degree", "coefficients"


def magnetics_from(section: Section) -> Magnetics:
    """A co-energy spline, a law or a network."""
    kind = section.text("kind")
    if kind == "coenergy_spline":
        return CoenergySpline(*spline_from(section))
    if kind == MATRIX_KIND:
        return _matrix_from(section)
    if kind == TENSOR_KIND:
        return _tensor_from(section)
    if kind == NETWORK_KIND:
        return _network_from(section)
    if kind != "law":
        raise section.refusal("kind", f"coenergy_spline, {MATRIX_KIND}, {TENSOR_KIND}, {NETWORK_KIND} or law")
    law = section.item("law", law_by_name)
    section.section("shape").refuse_others(tuple(p.name for p in law.shape))
    return LawMagnetics(
        law_name=law.name,
        coefficients=tuple(_coefficient_from(item, law.basis) for item in section.sections("coefficients")),
        shape={p.name: section.section("shape").number(p.name) for p in law.shape},
        constant_inductance_H=section.number("constant_inductance_H"),
        constant_flux_linkage_Wb=section.number("constant_flux_linkage_Wb"),
        reference_distance_m=section.optional_number("reference_distance_m"),
    )


def _network_from(section: Section) -> NetworkMagnetics:
    positive = {key: section.number(key, positive=True) for key in ("reference_distance_m", "knee_A")}
    return section.record(NetworkMagnetics, others=("kind",), **positive)


def _coefficient_from(section: Section, basis: tuple[str, ...]) -> Coefficient:
    if section.text("basis") not in basis:
        raise section.refusal("basis", f"a column of the law ({', '.join(basis)})")
    bounds = section.data.get("bounds")
    if not isinstance(bounds, list) or len(bounds) != 2:
        raise section.refusal("bounds", "a pair, with null for a bound that is none")
    ends = Section(section.source, section.where("bounds"), dict(zip(("lower", "upper"), bounds, strict=True)))
    lower, upper = ends.optional_number("lower"), ends.optional_number("upper")
    return section.record(
        Coefficient,
        current_power=section.integer("current_power", 0, 16),
        bounds=(-math.inf if lower is None else lower, math.inf if upper is None else upper),
    )


def matrix_to(matrix: CoenergyMatrix) -> dict[str, Any]:
    """Several circuits' co-energy as JSON-ready data."""
    return {
        "kind": MATRIX_KIND,
        "circuits": matrix.names,
        **coordinate_to(matrix.coordinate),
        "u_knots": matrix.u_knots,
        "u_degree": matrix.u_degree,
        "coefficients": matrix.coefficients,
    }


def _matrix_from(section: Section) -> CoenergyMatrix:
    section.refuse_others(("kind", "circuits", *COORDINATE_KEYS, "u_knots", "u_degree", "coefficients"))
    names = section.names("circuits", 2)
    knots, degree = knots_from(section, "u_knots", section.integer("u_degree", 2, 9))
    needed = (len(knots) - degree - 1, (len(names) + 1) * (len(names) + 2) // 2)
    return CoenergyMatrix(
        names, coordinate_from(section, further=TWO_GAPS), knots, degree, section.shaped("coefficients", needed)
    )


def knots_from(section: Section, key: str, degree: int) -> tuple[FloatArray, int]:
    """Clamped knots, and their degree."""
    knots = section.array(key, 1)
    if not is_clamped(knots, degree):
        raise section.refusal(key, f"ascending, with {degree + 1} equal knots at both ends and fewer inside")
    return knots, degree


def tensor_to(tensor: CoenergyTensor) -> dict[str, Any]:
    """The co-energy of several circuits that saturate as JSON-ready data."""
    nested = nested_to(tensor, "circuits")
    named = [{"name": name, **along} for name, along in zip(tensor.names, nested["circuits"], strict=True)]
    return {"kind": TENSOR_KIND, **nested, "circuits": named}


def _tensor_from(section: Section) -> CoenergyTensor:
    along = section.sections("circuits")
    if len(along) < 2:
        raise section.refusal("circuits", "a list of two or more, each with name, knots_A and degree")
    return CoenergyTensor(
        tuple(one.text("name") for one in along),
        *nested_from(section, "circuits", along, least_degree=2, others=("kind",), named=True),
    )


def nested_to(spline: CoenergyTensor | SensedField, key: str) -> dict[str, Any]:
    """A spline of the distance and any currents as JSON-ready data, the currents' knots under a key."""
    along = zip(spline.current_knots_A, spline.current_degrees, strict=True)
    return {
        **coordinate_to(spline.coordinate),
        "u_knots": spline.u_knots.tolist(),
        "u_degree": spline.u_degree,
        key: [{"knots_A": knots.tolist(), "degree": degree} for knots, degree in along],
        "coefficients": spline.coefficients.tolist(),
    }


def nested_from(
    section: Section,
    key: str,
    along: Sequence[Section],
    *,
    least_degree: int,
    others: tuple[str, ...] = (),
    named: bool = False,
) -> tuple[DistanceCoordinate, FloatArray, int, tuple[FloatArray, ...], tuple[int, ...], FloatArray]:
    """Coordinate, knots and degree in it, those in each current, and coefficients, as :func:`nested_to` wrote them.

    Parameters
    ----------
    along : sequence of Section
        One a current.
    others : tuple of str
        Further keys of the section.
    named : bool
        Whether each current's section has a name.
    """
    section.refuse_others((*others, *COORDINATE_KEYS, "u_knots", "u_degree", key, "coefficients"))
    for one in along:
        one.refuse_others((*(("name",) if named else ()), "knots_A", "degree"))
    knots, degree = knots_from(section, "u_knots", section.integer("u_degree", least_degree, 9))
    each = [knots_from(one, "knots_A", one.integer("degree", least_degree, 9)) for one in along]
    needed = tuple(len(inner) - power - 1 for inner, power in ((knots, degree), *each))
    inner, powers = tuple(one for one, _ in each), tuple(power for _, power in each)
    return (
        coordinate_from(section, further=TWO_GAPS),
        knots,
        degree,
        inner,
        powers,
        section.shaped("coefficients", needed),
    )


def coordinate_to(coordinate: DistanceCoordinate) -> dict[str, Any]:
    """The coordinate of the distance as JSON-ready data."""
    if coordinate.stretch_m is not None:
        return {
            "coordinate": TWO_GAPS,
            "reference_distance_m": coordinate.reference_distance_m,
            "stretch_m": coordinate.stretch_m,
        }
    return {
        "coordinate": INVERSE if coordinate.inverse else PLAIN,
        "reference_distance_m": coordinate.reference_distance_m,
        **({"distance_shift_m": coordinate.distance_shift_m} if coordinate.inverse else {}),
    }


def spline_to(coordinate: DistanceCoordinate, spline: TensorSpline) -> dict[str, Any]:
    """Coordinate, knots and coefficients of a co-energy or a Hall field as JSON-ready data."""
    return {
        **coordinate_to(coordinate),
        "u_knots": spline.x_knots.tolist(),
        "current_knots_A": spline.y_knots.tolist(),
        "u_degree": spline.x_degree,
        "current_degree": spline.y_degree,
        "coefficients": spline.coefficients.tolist(),
    }


def spline_from(section: Section, beyond: int = PARABOLA) -> tuple[DistanceCoordinate, TensorSpline]:
    """Coordinate and spline of a co-energy or a Hall field, which goes on as a line beyond its currents."""
    section.refuse_others(_SPLINE_KEYS)
    x_knots, x_degree = knots_from(section, "u_knots", section.integer("u_degree", 1, 9))
    y_knots, y_degree = knots_from(section, "current_knots_A", section.integer("current_degree", 0, 9))
    shape = len(x_knots) - x_degree - 1, len(y_knots) - y_degree - 1
    spline = TensorSpline(x_knots, y_knots, x_degree, y_degree, section.shaped("coefficients", shape), beyond)
    return coordinate_from(section), spline


def coordinate_from(section: Section, *, further: str = PLAIN) -> DistanceCoordinate:
    """The coordinate, of which several circuits have a further one; an inverse distance in files of schema 1."""
    kind = section.text("coordinate") if "coordinate" in section.data else INVERSE
    allowed = list(dict.fromkeys((INVERSE, PLAIN, further)))
    if kind not in allowed:
        raise section.refusal("coordinate", " or ".join(allowed))
    if kind == TWO_GAPS:
        middle, stretch = section.number("reference_distance_m"), section.number("stretch_m", positive=True)
        return DistanceCoordinate(middle, inverse=False, stretch_m=stretch)
    shift = section.number("distance_shift_m", lower=0.0, absent=0.0)
    if shift and kind == PLAIN:
        raise section.refusal("distance_shift_m", f"absent beside coordinate {PLAIN}")
    return DistanceCoordinate(section.number("reference_distance_m", positive=True), shift, kind == INVERSE)
