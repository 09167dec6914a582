"""A comparison as a page, and as pictures: points on curves, maps of the misfit, what else it changes with."""

from pathlib import Path
from typing import TYPE_CHECKING

from femfit.core.atomic import replacing
from femfit.identify.comparison.compare import Comparison
from femfit.identify.readings.observations import Observations
from femfit.report.measured_figures import covariate_figure, residual_maps_figure
from femfit.report.section import Page, Picture, Section, render_page, text
from femfit.report.section_curves import curves_section
from femfit.report.style import style, svg_uri

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOTS_PER_INCH = 150
PANELS = 3
"""Most panels of a picture."""


def save_comparison_pictures(observations: Observations, comparison: Comparison, directory: Path) -> list[Path]:
    """Write ``misfit-maps.png`` and ``misfit-CHANNEL-1.png`` and so on."""
    floors = _floors(comparison)
    figures = {"misfit-maps": _maps(comparison)}
    for channel, floor in floors.items():
        lines = [one.along[0] for one in comparison.maps if one.channel == channel and len(one.along) == 1]
        names = [name for name in lines if name != "mount"]
        for start in range(0, len(names), PANELS):
            shown = names[start : start + PANELS]
            picture = covariate_figure(observations, observations.residual / floor, None, channel, shown)
            figures[f"misfit-{channel}-{1 + start // PANELS}"] = picture
    files = []
    for name, figure in figures.items():
        file = directory / f"{name}.png"
        with style(), replacing(file) as partial:
            figure.savefig(partial, dpi=DOTS_PER_INCH)
        files.append(file)
    return files


def render_comparison(comparison: Comparison) -> str:
    """The page on a comparison: the answer, measured points on the model's curves, maps of the misfit."""
    observations = comparison.observations
    maps = Picture(
        "misfit-maps",
        svg_uri(_maps(comparison), "misfit-maps"),
        "Maps of recorded minus predicted readings over distance and current, one for each channel.",
        text("Recorded minus predicted, averaged over the readings of each setting."),
    )
    return render_page(
        Page(
            title=f"{comparison.model.name}: the bench and the model",
            lead="what was measured beside the model's predictions",
            summary=[line for line in str(comparison).splitlines() if line.strip()][:6],
            sections=[
                curves_section(comparison.model, observations, (), _floors(comparison)),
                Section("misfit", "Where the misfit is", (maps,)),
            ],
        )
    )


def _floors(comparison: Comparison) -> dict[str, float]:
    return {one.channel: one.noise_floor for one in comparison.channels if one.noise_floor is not None}


def _maps(comparison: Comparison) -> "Figure":
    observations, floors = comparison.observations, _floors(comparison)
    known = len(floors) == len(comparison.channels)
    scale = floors if known else dict.fromkeys(observations.channels, 1.0)
    return residual_maps_figure(observations, [("", observations.residual)], scale, known)
