"""The report's section on the actuator itself."""

from markupsafe import Markup

from femfit.core.constants import GRAVITY
from femfit.report.actuator_figure import actuator_figure
from femfit.report.content import ReportContent
from femfit.report.embed import svg_uri
from femfit.report.kinds import has_magnet, saturates
from femfit.report.numbers import noise_words, plain, quantity
from femfit.report.section import DataTable, Picture, Section, text

MM = 1e3

SMALL = 1e-3
"""Forces below this part of the largest one are none: what is left of the solver's errors."""


def actuator_section(content: ReportContent, distance: float, cutaway: Picture | None) -> Section:
    """Drawing and data.

    Parameters
    ----------
    distance : float
        At which the moving part is drawn, in m.
    """
    actuator = content.actuator
    drawing = Picture(
        "actuator",
        svg_uri(actuator_figure(actuator, distance), "actuator"),
        f"Full section of {actuator.name}: {_kinds(content)}, with dimensions in millimetres.",
        text(
            "Full section, dimensions in mm. The distance d counts from the electromagnet's face (z = 0) to the "
            "nearest face of the moving part, drawn here at d = {} mm. Force is positive towards the electromagnet.{}",
            plain(MM * distance, 4),
            " The arrow is the magnetisation." if has_magnet(actuator) else "",
        ),
    )
    lead = text(
        "An electromagnet with one winding acts on {} that moves along the common axis. {}",
        "a permanent magnet" if _moving_magnet(content) else "a moving part without remanence",
        _what_current_does(content),
    )
    blocks = (lead, *((cutaway,) if cutaway else ()), drawing, _data(content))
    return Section("actuator", "The actuator", blocks)


def _moving_magnet(content: ReportContent) -> bool:
    return any(region.material.remanence_T for region in content.actuator.moving.regions)


def _what_current_does(content: ReportContent) -> str:
    actuator, rows = content.actuator, content.fit.rows
    if not has_magnet(actuator):
        return "Without current there is no force; the force " + (
            "grows with the current, whatever its sign."
            if saturates(actuator)
            else "grows with the square of the current."
        )
    at_rest = rows.force[rows.current == 0.0]
    if not at_rest.size:
        return "The magnet acts without current already; the current adds to that force."
    if max(abs(at_rest)) <= SMALL * max(abs(rows.force)):
        return "Without current there is no force; with the current the force changes its sign."
    ways = ("attracted", at_rest.max()), ("pushed away", -at_rest.min())
    way = " or, at other distances, ".join(name for name, force in ways if force > SMALL * max(abs(at_rest)))
    return f"It is {way} without current already; the current adds to that force."


def _kinds(content: ReportContent) -> str:
    actuator = content.actuator
    names = [region.name.replace("_", " ") for region in actuator.fixed]
    moving = [region.name.replace("_", " ") for region in actuator.moving.regions]
    return f"{', '.join(names)} and the winding above, {', '.join(moving)} below"


def _data(content: ReportContent) -> DataTable:
    actuator = content.actuator
    coil, supply, axes = actuator.coil, actuator.supply, actuator.sweep
    wire = "" if coil.wire_diameter_m is None else f", wire {plain(MM * coil.wire_diameter_m)} mm"
    weight = actuator.moving.mass_kg * GRAVITY
    rows: list[tuple[str, str]] = [
        ("moving mass, weight", f"{plain(1e3 * actuator.moving.mass_kg)} g, {quantity(weight, 'N')}"),
        ("winding", f"{plain(coil.turns)} turns{wire}"),
        ("resistance", quantity(coil.resistance_ohm, "Ω")),
    ]
    table = content.sweep.valid_rows()
    if "inductance_H" in table and table["inductance_H"].notna().any():
        low, high = float(table["inductance_H"].min()), float(table["inductance_H"].max())
        span = quantity(low, "H", 4) if high - low < 5e-4 * high else f"{quantity(low, 'H')} to {quantity(high, 'H')}"
        rows.append(("inductance over the sweep", span))
    rows.append(("driver", f"{plain(supply.voltage_min_V)} to {plain(supply.voltage_max_V)} V"))
    rows.append(("controller's period", quantity(supply.sample_time_s, "s")))
    hall = actuator.hall
    if hall is None:
        rows.append(("Hall element", "none"))
    else:
        place = f"r = {plain(MM * hall.radius_m)} mm, z = {plain(MM * hall.height_m)} mm"
        scale = f"{plain(hall.sensitivity_V_per_T)} V/T about {plain(hall.quiescent_V)} V"
        converter = f"{hall.adc_bits} bits" if hall.adc_bits else "no converter"
        rows.append(("Hall element", f"{place}; {scale}; {converter}; {noise_words(hall.noise_V)}"))
    currents = f"{plain(axes.currents_A[0])} to {plain(axes.currents_A[-1])} A"
    distances = f"{plain(MM * axes.distances_m[0])} to {plain(MM * axes.distances_m[-1])} mm"
    rows.append(("sweep", f"{currents}, {distances}"))
    return DataTable(Markup("Data of the actuator file, and what follows from them"), (), tuple(rows))
