"""The diagnosis report's section on where the model fails."""

import numpy as np
from markupsafe import Markup

from femfit.identify.decision.diagnosis_text import verdict_sentence
from femfit.report.diagnosis_content import DiagnosisContent
from femfit.report.measured_figures import covariate_figure, residual_maps_figure
from femfit.report.numbers import NOTHING, p_value, quantity, significant
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.report.style import svg_uri
from femfit.tables.measurement import CHANNEL_WORDS

SCALAR = (
    "coil_temperature_C", "magnet_temperature_C", "order", "elapsed", "branch", "run", "velocity_m_s",
    "current_rate_A_s",
)  # fmt: skip
"""Covariates that a map over distance and current does not show."""


def misfit_section(content: DiagnosisContent) -> Section:
    """Maps of recorded minus predicted, and what the misfit changes with."""
    diagnosis, observations = content.diagnosis, content.observations
    known = bool(content.sigma)
    scale = content.sigma if known else dict.fromkeys(observations.channels, 1.0)
    blocks: list[Block] = [_argument(content), _table(content)]
    blocks.append(
        Picture(
            "misfit-maps",
            svg_uri(residual_maps_figure(observations, [("", observations.residual)], scale, known), "misfit-maps"),
            "Maps of recorded minus predicted readings over distance and current, one a channel.",
            text(
                "Recorded minus predicted, averaged over the readings of each setting{}. Red: more was recorded than "
                "the model predicts; blue: less.",
                ", in standard deviations of a single reading" if known else "",
            ),
        )
    )
    names = [name for name in diagnosis.where.covariates if name in SCALAR]
    if names and known:
        channel = diagnosis.where.channel
        values = observations.residual / scale[channel]
        blocks.append(
            Picture(
                "misfit-covariates",
                svg_uri(covariate_figure(observations, values, None, channel, names), "misfit-covariates"),
                f"Misfit of the {CHANNEL_WORDS[channel]} against {', '.join(names)}.",
                Markup("The same misfit against what else it changes with; bars are two standard errors."),
                narrow=len(names) == 1,
            )
        )
    return Section("misfit", "Where the model fails", tuple(blocks))


def _argument(content: DiagnosisContent) -> Markup:
    diagnosis = content.diagnosis
    gate = diagnosis.lack_of_fit_before
    if gate is None:
        return Markup(
            "Below is what was recorded beside what the model predicts. Whether the difference is more than noise "
            "cannot be said."
        )
    test = text(
        "A test against {} smooth patterns over all settings finds {} times the misfit that noise alone would leave "
        "({}).",
        gate.degrees_of_freedom,
        significant(gate.statistic, 3),
        p_value(gate.p_value),
    )
    if diagnosis.verdict == "nothing_missing":
        return text("{} {}", verdict_sentence(diagnosis), test)
    return text("<strong>{}</strong> {}", diagnosis.where.sentence, test)


def _table(content: DiagnosisContent) -> DataTable:
    diagnosis, observations = content.diagnosis, content.observations
    rms = {one.channel: one.rms_before for one in diagnosis.error_fall.channels}
    rows = []
    for name in observations.channels:
        residual = observations.residual[observations.of(name)]
        unit = name.rpartition("_")[2]
        floor = diagnosis.noise_floor.get(name)
        rows.append(
            (
                CHANNEL_WORDS[name],
                quantity(rms[name], unit),
                quantity(float(np.abs(residual).max()), unit),
                quantity(floor, unit) if floor else NOTHING,
                significant(rms[name] / floor, 3) if floor else NOTHING,
            )
        )
    return DataTable(
        Markup("Recorded minus predicted, re-mounts and run offsets included"),
        ("channel", "rms", "largest", "noise σ", "rms over noise"),
        tuple(rows),
    )
