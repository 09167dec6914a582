"""The report's first lines: what came out, in a few numbers."""

import numpy as np
from markupsafe import Markup

from femfit.field.sweep_summary import summarise
from femfit.fit.ranking import TARGET
from femfit.report.content import ReportContent
from femfit.report.numbers import percent, plain, quantity
from femfit.report.section import text
from femfit.report.section_candidates import coenergy_misfit


def summary(content: ReportContent) -> tuple[Markup, ...]:
    """Results, one sentence each.

    Returns
    -------
    tuple of Markup
        The sweep, the reference, the recommended law, the loop.
    """
    found = [_sweep(content), _reference(content), _law(content), _loop(content)]
    return tuple(sentence for sentence in found if sentence)


def _sweep(content: ReportContent) -> Markup:
    rows = content.fit.rows
    error = ""
    if np.any(rows.force_error > 0.0):
        error = f"; estimated error at most {percent(summarise(content.sweep)['force_error_relative_max'])}"
    return text(
        "<strong>Field.</strong> {} points solved, forces of {} to {}{}.",
        len(rows.force),
        quantity(float(rows.force.min()), "N"),
        quantity(float(rows.force.max()), "N"),
        error,
    )


def _reference(content: ReportContent) -> Markup:
    misfit = coenergy_misfit(content)
    if misfit is None:
        return Markup("")
    return text(
        "<strong>Model.</strong> One co-energy for force, flux linkage, motional constant and inductance: {} of the "
        "force (rms).",
        percent(misfit.force_rms_relative),
    )


def _law(content: ReportContent) -> Markup:
    ranking = content.fit.ranking
    if ranking is None:
        return Markup("")
    best = ranking.recommended
    paper = next((c for c in ranking.candidates if c.law.name == "F1e" and c.fit is not None), None)
    compared = "" if paper is None or paper is best else f", where the paper's F1e has {percent(paper.held_out_rms)}"
    if not ranking.reached:
        return text(
            "<strong>Law.</strong> No small force law reaches {} of the {} on held-out rows; the best, {}, has {}{}.",
            percent(TARGET),
            ranking.of,
            best.law.name,
            percent(best.held_out_rms),
            compared,
        )
    return text(
        "<strong>Law.</strong> {} predicts held-out rows within {} of the {} in {} operations{}.",
        best.law.name,
        percent(best.held_out_rms),
        ranking.of,
        best.fit.operations if best.fit else 0,
        compared,
    )


def _loop(content: ReportContent) -> Markup:
    study = content.study
    if study is None:
        return text("<strong>Loop.</strong> Not closed: {}", content.why_no_loop)
    filtered = [row for row in study.steps if row.measurement == "ukf"]
    lost, runs = sum(row.runs - row.held for row in filtered), sum(row.runs for row in filtered)
    span = text(
        "Steps between {} and {} mm",
        plain(1e3 * study.design.points[0].distance_m),
        plain(1e3 * study.design.points[-1].distance_m),
    )
    ratios = [row.ratio for row in study.holds if row.held]
    if lost == runs or not ratios:
        return text("<strong>Loop.</strong> {}: {} of {} runs lost.", span, lost, runs)
    bounds = [row.bound for row in study.holds]
    better = text(
        ", {} to {} times better at rest than the direct measurement (bound: {} to {})",
        f"{min(ratios):.1f}",
        f"{max(ratios):.1f}",
        f"{min(bounds):.1f}",
        f"{max(bounds):.1f}",
    )
    return text(
        "<strong>Loop.</strong> {}, {}; the filter knows the distance within {} rms during the steps{}.",
        span,
        "no run lost" if not lost else f"{lost} of {runs} runs lost",
        quantity(max(row.rms_m for row in filtered), "m"),
        "" if study.no_direct else better,
    )
