"""Fields at sensors in a model file: of one current as before there were several, else of any currents."""

from typing import Any

from femfit.model.hall import HallField, HallSpline
from femfit.model.json_magnetics import coordinate_from, coordinate_to, knots_from, spline_from
from femfit.model.json_section import Section
from femfit.model.sensed_field import SensedField


def sensed_to(field: SensedField) -> dict[str, Any]:
    """A field of any currents as JSON-ready data."""
    along = zip(field.current_knots_A, field.current_degrees, strict=True)
    return {
        **coordinate_to(field.coordinate),
        "u_knots": field.u_knots.tolist(),
        "u_degree": field.u_degree,
        "currents": [{"knots_A": knots.tolist(), "degree": degree} for knots, degree in along],
        "coefficients": field.coefficients.tolist(),
    }


def hall_field_from(section: Section) -> HallField:
    """The field at a Hall element, of one current or of any."""
    return sensed_from(section) if "currents" in section.data else HallSpline(*spline_from(section))


def sensed_from(section: Section) -> SensedField:
    """A field of any currents."""
    place = ("coordinate", "reference_distance_m", "distance_shift_m")
    section.refuse_others((*place, "u_knots", "u_degree", "currents", "coefficients"))
    along = section.sections("currents") if section.data.get("currents") != [] else ()
    for one in along:
        one.refuse_others(("knots_A", "degree"))
    knots, degree = knots_from(section, "u_knots", section.integer("u_degree", 1, 9))
    each = [knots_from(one, "knots_A", one.integer("degree", 1, 9)) for one in along]
    needed = tuple(len(inner) - power - 1 for inner, power in ((knots, degree), *each))
    coefficients = section.array("coefficients", len(needed))
    if coefficients.shape != needed:
        raise section.refusal("coefficients", f"nested lists of {needed} numbers, as the knots ask for")
    inner, powers = tuple(one for one, _ in each), tuple(power for _, power in each)
    return SensedField(coordinate_from(section), knots, degree, inner, powers, coefficients)
