"""A comparison in plain sentences."""

from femfit.identify.comparison.compare import ChannelMisfit, Comparison
from femfit.identify.readings.amounts import CHANNEL_WORDS, amount, chance, times
from femfit.identify.readings.notes import first_notes, last_notes

_VERDICTS = {
    "agrees": "The model agrees with these data within their noise{scatter}.",
    "fails": "The model fails: {where}",
    "wrong_shape": "The model fails, but no more than it misses the sweep that it was fitted to: {where}",
    "compare_only": "Nothing tells the noise, so this is no verdict. The misfit: {where}",
}

SCATTERED = 1.5
"""Misfit over noise from which a misfit that nothing is missing in is said to be the mounts' as well."""


def comparison_lines(comparison: Comparison) -> list[str]:
    """The result as lines of text.

    Returns
    -------
    list of str
        A line a channel, the verdict with its test, a law's own shape, and notes.
    """
    lines = [*first_notes(comparison.findings), *(_channel(one) for one in comparison.channels)]
    if comparison.mount_m is not None:
        lines.append(f"{comparison.placed_by} the distance scatters by about {amount(comparison.mount_m, 'mount_m')}")
    if comparison.structure is not None:
        gate = comparison.structure
        lines.append(
            f"structure: {times(gate.statistic)} times what noise gives, in {gate.degrees_of_freedom} smooth patterns, "
            f"{chance(gate.p_value)}"
        )
    scatter = f" and the distance's scatter {comparison.placed_by}" if _hidden_by_scatter(comparison) else ""
    lines.append(_VERDICTS[comparison.verdict].format(where=comparison.where.sentence, scatter=scatter))
    if comparison.shape is not None:
        lines.append(comparison.shape.sentence)
    return lines + last_notes(comparison.findings)


def _hidden_by_scatter(comparison: Comparison) -> bool:
    """Whether a channel misses by clearly more than the noise of its readings."""
    floors = [(one.rms, one.noise_floor) for one in comparison.channels if one.noise_floor is not None]
    return comparison.mount_m is not None and any(rms > SCATTERED * floor for rms, floor in floors)


def _channel(one: ChannelMisfit) -> str:
    text = f"{CHANNEL_WORDS[one.channel]}: rms misfit {amount(one.rms, one.channel)} in {one.readings} readings"
    if one.noise_floor is not None:
        source = one.noise_source if one.noise_readings is None else f"{one.noise_readings:.0f} repeats"
        text += (
            f", {times(one.rms / one.noise_floor)} times the noise of {amount(one.noise_floor, one.channel)} ({source})"
        )
    worst = one.largest
    text += (
        f"; largest {amount(worst.value, one.channel)} at {amount(worst.distance_m, 'distance_m', 3)} and "
        f"{amount(worst.current_A, 'current_A')}"
    )
    return text + (f"; lack of fit {chance(one.lack_of_fit.p_value)}" if one.lack_of_fit is not None else "")
