"""The diagnosis report's section on how far the error fell."""

import shlex
from collections.abc import Mapping

from markupsafe import Markup

from femfit.identify.decision.constants import LEVEL_AFTER
from femfit.identify.refit.add_result import AddResult
from femfit.report.diagnosis_content import DiagnosisContent
from femfit.report.explained_figures import waterfall_figure
from femfit.report.measured_figures import residual_maps_figure
from femfit.report.numbers import NOTHING, p_value, percent, plain, quantity, significant
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.report.style import svg_uri
from femfit.tables.measurement import CHANNEL_WORDS


def fall_section(content: DiagnosisContent) -> Section | None:
    """Error before, after and the noise floor per channel, with maps of what is left.

    Returns
    -------
    Section or None
        None where there is nothing to add.
    """
    if content.diagnosis.campaign is None or content.after is None:
        return None
    observations, before, after = content.observations, content.observations.residual, content.after
    if content.added is not None:
        steps = [(step.text, dict(step.rms)) for step in content.added.steps]
        blocks: list[Block] = [_added(content.added)]
    else:
        fall = content.diagnosis.error_fall.channels
        names = " + ".join(one.name for one in content.diagnosis.missing)
        steps = [("model", {c.channel: c.rms_before for c in fall}), (names, {c.channel: c.rms_after for c in fall})]
        blocks = [_would(content)]
    floor = dict(content.diagnosis.noise_floor)
    blocks += [
        Picture(
            "waterfall",
            svg_uri(waterfall_figure(steps, floor), "waterfall"),
            "Error of each channel before, what each step takes off, and after, in units of the noise.",
            text(
                "Rms error of each channel over all readings, in units of its noise: before, what each step takes off, "
                "and after."
            ),
        ),
        _error_table(steps, floor),
        Picture(
            "after-maps",
            svg_uri(
                residual_maps_figure(observations, [("before", before), ("after", after)], content.sigma, sigma=True),
                "after-maps",
            ),
            "Maps of recorded minus predicted readings before and after.",
            Markup("Recorded minus predicted before (top) and after (below), in standard deviations of a reading."),
        ),
    ]
    if content.added is not None:
        blocks += _size_blocks(content.added)
    return Section("fall", "How far the error fell", tuple(blocks))


def _would(content: DiagnosisContent) -> Markup:
    names = [one.name for one in content.diagnosis.missing]
    more = "".join(f" --with {name}" for name in names[1:])
    return text(
        "With {} fitted to these readings the error becomes as below. <code>femfit add MODEL.json {} {}{} -o "
        "MODEL2.json</code> makes the model that has it, judged on runs that were not fitted.",
        " and ".join(names),
        names[0],
        shlex.quote(content.source),
        more,
    )


def _added(result: AddResult) -> Block:
    names = " and ".join(added.effect.name for added in result.added)
    base = (
        text(
            " Amplitudes of the base were fitted beside it, because that helps on runs left out: {}.",
            ", ".join(
                f"{name.removesuffix('_error')} {significant(100.0 * value, 2)} %"
                for added in result.base
                for name, value in added.parameters.items()
            ),
        )
        if result.base
        else ""
    )
    return text(
        "{} {} added to the model.{} What is left {} the lack-of-fit test ({}; before: {}).",
        names,
        "was" if len(result.added) == 1 else "were",
        base,
        "passes" if result.lack_of_fit_after.p_value > LEVEL_AFTER else "fails",
        p_value(result.lack_of_fit_after.p_value),
        p_value(result.lack_of_fit_before.p_value),
    )


def _error_table(steps: list[tuple[str, dict[str, float]]], floor: Mapping[str, float]) -> DataTable:
    rows = []
    for name in steps[0][1]:
        unit = name.rpartition("_")[2]
        last = steps[-1][1][name]
        rows.append(
            (
                CHANNEL_WORDS[name],
                *(quantity(values[name], unit) for _, values in steps),
                quantity(floor[name], unit) if name in floor else NOTHING,
                f"{last / floor[name]:.2f}" if name in floor else NOTHING,
            )
        )
    heads = ("model as it was", *(f"with {name}" for name, _ in steps[1:]))
    return DataTable(Markup("Rms error"), ("channel", *heads, "noise σ", "after over noise"), tuple(rows))


def _size_blocks(result: AddResult) -> list[Block]:
    rows = []
    for size in result.sizes:
        low, high = size.ci95
        rows.append(
            (
                size.effect,
                CHANNEL_WORDS[size.channel],
                quantity(size.change, size.channel),
                f"{quantity(low, size.channel)} … {quantity(high, size.channel)}",
                percent(size.of_largest),
                f"{plain(1e3 * size.distance_m, 4)} mm, {plain(size.current_A, 3)} A",
            )
        )
    blocks: list[Block] = [
        DataTable(
            Markup("How large each effect is: its largest change of each channel within the data"),
            ("effect", "channel", "change", "95 % interval", "of the largest", "where"),
            tuple(rows),
        ),
    ]
    if result.suspicious:
        items = Markup("").join(text("<li>{}</li>", sentence) for sentence in result.suspicious)
        blocks.append(text("Suspicious:<ul>{}</ul>", items))
    return blocks
