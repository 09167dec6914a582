"""The report's section on the Hall characteristic."""

from markupsafe import Markup

from femfit.report.content import ReportContent
from femfit.report.embed import svg_uri
from femfit.report.hall_figure import hall_figure
from femfit.report.numbers import noise_words, percent, plain, quantity
from femfit.report.section import Picture, Section, text


def hall_section(content: ReportContent) -> Section:
    """Coil part and magnet part; one sentence where there is no sensor."""
    title = "The Hall characteristic"
    hall, sensor = content.fit.hall, content.fit.model.sensor
    if hall is None or sensor is None:
        return Section(
            "hall", title, (Markup("This actuator has no Hall element, so there is no characteristic to show."),)
        )
    low, high = hall.coil_slope_T_per_A
    far, near = hall.magnet_field_T
    volt = sensor.sensitivity_V_per_T
    spread = (high - low) / abs(high) if high else 0.0
    step = sensor.quantisation_step
    converter = f" One step of the converter is {quantity(step, 'V')}." if step else ""
    return Section(
        "hall",
        title,
        (
            text(
                "The field at the Hall element splits into the magnet's part, {} to {} over the distances, and the "
                "coil's, {} per ampere; the latter changes by {} only with the distance. At {} V/T the output moves "
                "by {} from the magnet and by {} per ampere from the coil; {}.{} The fit meets "
                "the sweep's field within {} rms.",
                quantity(near, "T"),
                quantity(far, "T"),
                quantity(high, "T"),
                percent(spread),
                plain(volt),
                quantity(volt * (near - far), "V"),
                quantity(volt * high, "V"),
                noise_words(sensor.noise_V),
                converter,
                quantity(hall.rms_T, "T"),
            ),
            Picture(
                "hall",
                svg_uri(hall_figure(content.fit.model, content.fit.rows), "hall"),
                "Hall output of the coil over voltage and of the magnet over distance.",
                Markup(
                    "What the direct measurement inverts (Figure 11 of the paper): the coil's part is subtracted, the "
                    "rest is looked up as a distance."
                ),
            ),
        ),
    )
