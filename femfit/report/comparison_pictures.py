"""Pictures of a comparison: maps of the misfit, and what else it changes with."""

from pathlib import Path

from femfit.core.atomic import replacing
from femfit.identify.comparison.compare import Comparison
from femfit.identify.readings.observations import Observations
from femfit.report.measured_figures import covariate_figure, residual_maps_figure
from femfit.report.style import style

DOTS_PER_INCH = 150
PANELS = 3
"""Most panels of a picture."""


def save_comparison_pictures(observations: Observations, comparison: Comparison, directory: Path) -> list[Path]:
    """Write ``misfit-maps.png`` and ``misfit-CHANNEL-1.png`` and so on."""
    floors = {one.channel: one.noise_floor for one in comparison.channels if one.noise_floor is not None}
    known = len(floors) == len(comparison.channels)
    scale = floors if known else dict.fromkeys(observations.channels, 1.0)
    figures = {"misfit-maps": residual_maps_figure(observations, [("", observations.residual)], scale, known)}
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
