"""A diagnosis as one HTML file that reads as an argument and needs nothing beside it."""

from importlib.metadata import version
from pathlib import Path

from markupsafe import Markup

from femfit import __version__
from femfit.identify.comparison.fall import ErrorFall
from femfit.identify.decision.diagnosis_text import certainty_sentence, verdict_sentence
from femfit.report.diagnosis_content import DiagnosisContent
from femfit.report.page import write_page
from femfit.report.section import Block, DataTable, Page, Section, render_page, text
from femfit.report.section_curves import curves_section
from femfit.report.section_explained import alternatives_section, explained_section, next_section
from femfit.report.section_fall import fall_section
from femfit.report.section_measured import measured_section
from femfit.report.section_misfit import misfit_section


def write_diagnosis_report(content: DiagnosisContent, path: Path) -> Path:
    """Write the report of a diagnosis."""
    return write_page(render_diagnosis(content), path)


def render_diagnosis(content: DiagnosisContent) -> str:
    """The report as HTML text."""
    sections = [
        curves_section(content.model, content.observations, content.effects_after, content.sigma),
        measured_section(content),
        misfit_section(content),
        explained_section(content),
        alternatives_section(content),
        next_section(content),
        fall_section(content),
        _provenance(content),
    ]
    return render_page(
        Page(
            title=f"{content.model.name}: the bench and the model",
            lead=f"{content.source} beside the model's predictions",
            summary=_summary(content),
            sections=[section for section in sections if section is not None],
        )
    )


def _summary(content: DiagnosisContent) -> tuple[Markup, ...]:
    diagnosis = content.diagnosis
    said = [text("<strong>Verdict.</strong> {}", verdict_sentence(diagnosis))]
    if diagnosis.where.channel:
        said.append(text("<strong>Where.</strong> {}", diagnosis.where.sentence))
    if diagnosis.missing:
        said.append(text("<strong>How certain.</strong> {}", certainty_sentence(diagnosis)))
    if content.suggestions:
        said.append(text("<strong>Next.</strong> {}", content.suggestions[0].text))
    if content.added is not None:
        names = " and ".join(added.effect.name for added in content.added.added)
        said.append(text("<strong>Added.</strong> {}. {}.", names, _fall(content.added.fall)))
    elif diagnosis.missing:
        said.append(text("<strong>Error.</strong> {}.", _fall(diagnosis.error_fall)))
    return tuple(said)


def _fall(fall: ErrorFall) -> str:
    """The fall of the error in the channel that was worst."""
    return str(max(fall.channels, key=lambda one: one.before_over_noise or 0.0))


def _provenance(content: DiagnosisContent) -> Section:
    blocks: list[Block] = []
    if content.hashes:
        rows = tuple((name, text("<code>{}</code>", value)) for name, value in content.hashes)
        blocks.append(DataTable(Markup("SHA-256"), (), rows))
    versions = (("femfit", __version__), *((name, version(name)) for name in ("numpy", "scipy", "matplotlib")))
    blocks.append(DataTable(Markup("Versions"), (), tuple(versions)))
    return Section("provenance", "Where the numbers come from", tuple(blocks))
