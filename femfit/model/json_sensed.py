"""Fields at sensors in a model file: of one current as before there were several, else of any currents."""

from typing import Any

from femfit.model.bspline import LINE
from femfit.model.hall import HallField, HallSpline
from femfit.model.json_magnetics import nested_from, nested_to, spline_from
from femfit.model.json_section import Section
from femfit.model.sensed_field import SensedField


def sensed_to(field: SensedField) -> dict[str, Any]:
    """A field of any currents as JSON-ready data."""
    return nested_to(field, "currents")


def hall_field_from(section: Section) -> HallField:
    """The field at a Hall element, of one current or of any."""
    return sensed_from(section) if "currents" in section.data else HallSpline(*spline_from(section, LINE))


def sensed_from(section: Section) -> SensedField:
    """A field of any currents."""
    along = section.sections("currents") if section.data.get("currents") != [] else ()
    return SensedField(*nested_from(section, "currents", along, least_degree=1))
