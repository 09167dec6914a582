"""The diagnosis report's first section: what was measured, and how noisy it is."""

import numpy as np
from markupsafe import Markup

from femfit.identify.noise.whitening import NoiseModel
from femfit.report.diagnosis_content import DiagnosisContent
from femfit.report.measured_figures import settings_figure
from femfit.report.numbers import NOTHING, plain, quantity, significant
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.report.style import svg_uri
from femfit.tables.measurement import CHANNEL_WORDS


def measured_section(content: DiagnosisContent) -> Section:
    """Settings, channels, the noise floor and where it is known from."""
    observations = content.observations
    rows, moving = observations.covariates, content.recorded_motion
    blocks: list[Block] = [
        text(
            "{}{} readings of {} {} in {}{}, between {} and {} mm and {} and {} A.",
            text("{}: ", content.test_object) if content.test_object else "",
            f"{len(observations.value):,}",
            f"{len(rows):,}",
            "windows of a recorded motion" if moving else "settings",
            _counted(len(np.unique(rows["run"])), "run"),
            f" and {_counted(len(np.unique(rows['mount'])), 'mount')}" if _mounted(content) else "",
            plain(1e3 * float(rows["distance_m"].min()), 4),
            plain(1e3 * float(rows["distance_m"].max()), 4),
            plain(float(rows["current_A"].min()), 3),
            plain(float(rows["current_A"].max()), 3),
        ),
        Picture(
            "settings",
            svg_uri(settings_figure(observations), "settings"),
            "Distances and currents at which readings were taken, by run, and the temperatures meanwhile.",
            Markup("Where and when readings were taken. Runs at the same setting are drawn beside each other."),
        ),
        _noise(content),
    ]
    if content.notes:
        blocks.append(text("Notes: {}", content.notes))
    if observations.findings:
        items = Markup("").join(text("<li>{}</li>", finding) for finding in observations.findings)
        blocks.append(text("What was noticed in the data:<ul>{}</ul>", items))
    return Section("measured", "What was measured", tuple(blocks))


def _mounted(content: DiagnosisContent) -> bool:
    """Whether the data tell mounts apart, and not runs alone."""
    return not content.recorded_motion and "mount" in content.observations.given


def _counted(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def _noise(content: DiagnosisContent) -> Block:
    evidence = content.diagnosis.campaign
    if evidence is None:
        return Markup(
            "<strong>The noise of these data is not known</strong>: no setting was measured twice, and no sidecar "
            "declares it. Without a noise floor no misfit can be told from scatter, so that nothing is named below."
        )
    noise = evidence.noise
    rows = tuple(_noise_row(content, noise, c) for c in range(len(noise.channels)))
    return DataTable(
        text(
            "Noise of a single reading. {} to within {} (standard deviation); runs are offset and readings follow each "
            "other as the last columns say. None of this is taken for physics.",
            "Put back by hand, the body comes back"
            if _mounted(content)
            else "In each run the recorded distance is right",
            quantity(noise.mount_m, "m", 2),
        ),
        ("channel", "readings", "noise σ", "known from", "of the largest reading", "offset of a run", "correlation"),
        rows,
    )


def _noise_row(content: DiagnosisContent, noise: NoiseModel, c: int) -> tuple[str, ...]:
    name = noise.channels[c]
    here = content.observations.of(name)
    unit = name.rpartition("_")[2]
    source = noise.source.get(name, "")
    known = f"{significant(float(noise.repeats[c]), 3)} repeats" if source == "repeats" else source or "not known"
    largest = float(np.abs(content.observations.value[here]).max()) if here.any() else np.nan
    return (
        CHANNEL_WORDS[name],
        f"{int(here.sum()):,}",
        quantity(float(noise.sigma[c]), unit) if source else NOTHING,
        known,
        f"{significant(100.0 * float(noise.sigma[c]) / largest, 2)} %" if source and largest > 0.0 else NOTHING,
        quantity(float(noise.run[c]), unit, 2) if source else NOTHING,
        f"{noise.rho[c]:.2f}",
    )
