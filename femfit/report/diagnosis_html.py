"""A diagnosis as one HTML file that reads as an argument and needs nothing beside it."""

from importlib.metadata import version
from pathlib import Path

from markupsafe import Markup

from femfit import __version__
from femfit.identify.comparison.fall import ErrorFall
from femfit.report.diagnosis_content import DiagnosisContent
from femfit.report.page import write_page
from femfit.report.section import Block, DataTable, Page, Section, render_page, text
from femfit.report.section_curves import curves_section
from femfit.report.section_explained import alternatives_section, explained_section, next_section
from femfit.report.section_fall import fall_section
from femfit.report.section_measured import measured_section
from femfit.report.section_misfit import misfit_section


def write_diagnosis_report(content: DiagnosisContent, path: Path) -> Path:
    """Write the report of a diagnosis.

    Parameters
    ----------
    path : Path
        Of the HTML file; its directory is made if absent.

    Raises
    ------
    RunDirectoryError
        If the file would not stay below 3 MB.
    """
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
    names = " and ".join(one.name for one in diagnosis.missing)
    verdicts = {
        "nothing_missing": "Nothing is missing; the model explains these data within their noise.",
        "named": f"{names} is missing from the model; with it the misfit is within the noise.",
        "form_insufficient": f"{names} is missing from the model and explains nearly all; its exact form is another.",
        "unexplained": "Something is missing, and none of the catalogue's effects explains it.",
        "compare_only": "The data can be compared with the model, but without a noise floor nothing can be named.",
    }
    said = [text("<strong>Verdict.</strong> {}", _plural(verdicts[diagnosis.verdict], len(names.split())))]
    if diagnosis.where.channel:
        said.append(text("<strong>Where.</strong> {}", diagnosis.where.sentence))
    members = [" and ".join(one.members) for one in diagnosis.missing if len(one.members) > 1]
    if members:
        said.append(text("<strong>But.</strong> These data do not tell {} apart.", "; nor ".join(members)))
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


def _plural(sentence: str, words: int) -> str:
    """A sentence about one effect as one about several."""
    if words < 2:
        return sentence
    for one, several in ((" is missing from", " are missing from"), ("with it", "with them"), ("explains", "explain")):
        sentence = sentence.replace(one, several)
    return sentence.replace("its exact form", "their exact form")


def _provenance(content: DiagnosisContent) -> Section:
    blocks: list[Block] = []
    if content.hashes:
        rows = tuple((name, text("<code>{}</code>", value)) for name, value in content.hashes)
        blocks.append(DataTable(Markup("SHA-256"), (), rows))
    versions = (("femfit", __version__), *((name, version(name)) for name in ("numpy", "scipy", "matplotlib")))
    blocks.append(DataTable(Markup("Versions"), (), tuple(versions)))
    return Section("provenance", "Where the numbers come from", tuple(blocks))
