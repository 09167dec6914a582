"""The diagnosis report's section on how far the error fell."""

from collections.abc import Mapping

from markupsafe import Markup

from femfit.identify.readings.amounts import CHANNEL_WORDS, amount
from femfit.identify.refit.add_result import AddResult
from femfit.identify.refit.unseen import beside_random, channel_rms
from femfit.report.diagnosis_content import DiagnosisContent
from femfit.report.explained_figures import waterfall_figure
from femfit.report.measured_figures import residual_maps_figure
from femfit.report.numbers import NOTHING, percent, plain, quantity, significant
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.report.section_misfit import p_value
from femfit.report.style import svg_uri

FAILS = 0.005
"""p-value below which structure is left, as in the decision."""

AS_READ = ("before", "after", "floor")


def fall_section(content: DiagnosisContent) -> Section | None:
    """Error before, after and the noise floor per channel, with maps of what is left.

    Parameters
    ----------
    content : DiagnosisContent
        With what was added, or what the diagnosis names.

    Returns
    -------
    Section or None
        None where there is nothing to add.
    """
    evidence = content.examination.evidence
    if evidence is None or content.after is None:
        return None
    observations, before, after = content.observations, content.observations.residual, content.after
    if content.added is not None:
        steps = [(step.text, dict(step.unseen)) for step in content.added.steps]
        floor = dict(content.added.floor)
        blocks: list[Block] = [_added(content.added)]
    else:
        floor = {name: evidence.noise.floor[name] for name in evidence.noise.source}
        rms = [channel_rms(observations, beside_random(r, evidence.whitening)) for r in (before, after)]
        steps = [("model", rms[0]), (" + ".join(one.name for one in content.diagnosis.missing), rms[1])]
        blocks = [_would(content)]
    blocks += [
        Picture(
            "waterfall",
            svg_uri(waterfall_figure(steps, floor), "waterfall"),
            "Error of each channel before, what each step takes off, and after, in units of the noise.",
            text(
                "Rms error of each channel in units of its noise, beside each run's own re-mount: before, what each "
                "step takes off, and after{}.",
                ", on runs that were not fitted" if content.added else ", on the runs that were fitted",
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
        content.source,
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
        "{} {} added to the model. On runs left out, each in turn, the error is <strong>{} times the noise</strong> "
        "(root mean square over the channels).{} What is left {} the lack-of-fit test (p {}; before: p {}).",
        names,
        "was" if len(result.added) == 1 else "were",
        f"{result.unseen_ratio:.2f}",
        base,
        "passes" if result.gate_after.p_value > FAILS else "fails",
        p_value(result.gate_after.p_value),
        p_value(result.gate_before.p_value),
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


def _signed(value: float, channel: str) -> str:
    return amount(value, channel, 3).replace("-", "−")


def _size_blocks(result: AddResult) -> list[Block]:
    rows = []
    for size in result.sizes:
        low, high = size.ci95
        rows.append(
            (
                size.effect,
                CHANNEL_WORDS[size.channel],
                _signed(size.change, size.channel),
                f"{_signed(low, size.channel)} … {_signed(high, size.channel)}",
                percent(size.of_largest),
                f"{plain(1e3 * size.distance_m, 4)} mm, {plain(size.current_A, 3)} A",
            )
        )
    read = result.as_read
    blocks: list[Block] = [
        DataTable(
            Markup(
                "The same with each run's re-mount and offset in it, which no model can know; a perfect model is "
                "expected to leave the last column"
            ),
            ("channel", "before", "after", "expected"),
            tuple(
                (CHANNEL_WORDS[name], *(quantity(read[key][name], name.rpartition("_")[2]) for key in AS_READ))
                for name in read["after"]
            ),
        ),
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
