"""The diagnosis report's first section: measured points on the model's curves."""

from collections.abc import Mapping, Sequence

from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.curves import measured_curves
from femfit.identify.readings.observations import Observations
from femfit.model.actuator_model import ActuatorModel
from femfit.report.curves import curves_figure, worst_first
from femfit.report.section import Picture, Section, text
from femfit.report.style import svg_uri
from femfit.tables.measurement import CHANNEL_WORDS


def curves_section(
    model: ActuatorModel,
    observations: Observations,
    effects: Sequence[AddedEffect],
    noise: Mapping[str, float],
) -> Section:
    """Each channel's readings on the model's curves before and after, the worst channel first.

    Parameters
    ----------
    effects : sequence of AddedEffect
        What was added to the model, or what a diagnosis names; none where nothing is.
    """
    curves = measured_curves(model, observations, after=effects, noise=dict(noise))
    names = " and ".join(dict.fromkeys(one.effect.name for one in effects))
    blocks = []
    for one in worst_first(curves):
        channel = CHANNEL_WORDS[one.channel]
        after = f" Left: the model as it was; right: with {names}." if effects else ""
        band = " The grey band is the noise of one reading." if one.noise is not None else ""
        what = ", points on the model's lines" if len(one.before) else ""
        blocks.append(
            Picture(
                f"curves-{one.channel}",
                svg_uri(curves_figure(one, fitted=bool(effects)), f"curves-{one.channel}"),
                f"Readings of the {channel} on the model's curves, with measured minus model below.",
                text("Readings of the {}{}.{} Below: measured minus model.{}", channel, what, after, band),
            )
        )
    return Section("curves", "Measured points on the model's curves", tuple(blocks))
