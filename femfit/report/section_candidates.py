"""The report's section on the candidates: ranked, recommended, and the co-energy beside them."""

import numpy as np
from markupsafe import Markup

from femfit.fit.coenergy import SHAPES, CoenergyFit
from femfit.fit.law_fit import LawFit
from femfit.fit.misfit import misfit_to_rows
from femfit.fit.ranking import TARGET, Candidate, Ranking
from femfit.model.actuator_model import Misfit
from femfit.report.candidates_figure import (
    law_force,
    ranking_figure,
    residual_figure,
)
from femfit.report.content import ReportContent
from femfit.report.embed import svg_uri
from femfit.report.formula import formula_markup
from femfit.report.numbers import percent, plain, quantity, significant
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.report.sweep_grid import sweep_grid


def coenergy_misfit(content: ReportContent) -> Misfit | None:
    """How far the co-energy is from the sweep; None where there is none."""
    fit = content.fit.coenergy
    return None if fit is None else misfit_to_rows(fit.magnetics, content.fit.rows)


def candidates_section(content: ReportContent) -> Section | None:
    """The candidates ranked, residual maps, the recommended law, the co-energy."""
    ranking = content.fit.ranking
    if ranking is None or ranking.recommended.fit is None:
        return None
    best = ranking.recommended.fit
    blocks: list[Block] = [
        _recommendation(ranking, has_coenergy=content.fit.coenergy is not None),
        Picture(
            "ranking",
            svg_uri(ranking_figure(ranking), "ranking"),
            "Held-out error of each candidate law over its floating-point operations.",
            text(
                "Each candidate's error on rows that it was not fitted to, against its cost. Ringed: {}.",
                "recommended" if ranking.recommended.held_out_rms <= TARGET else "the best, which misses the target",
            ),
        ),
        _ranking_table(ranking),
        _term_table(best, content),
    ]
    if content.fit.coenergy is not None:
        blocks.append(_coenergy(content.fit.coenergy, misfit_to_rows(content.fit.coenergy.magnetics, content.fit.rows)))
    if sweep_grid(content.fit.rows) is not None:
        blocks.append(_residuals(content, best))
    return Section("candidates", "Which law does", tuple(blocks))


def _recommendation(ranking: Ranking, *, has_coenergy: bool) -> Block:
    best = ranking.recommended
    fitted = [c for c in ranking.candidates if c.fit is not None]
    sentence = text(
        "{} laws were ranked by their error on held-out rows (blocks of neighbouring distances, single currents). ",
        len(fitted),
    )
    if ranking.why_of:
        sentence += text("Their errors are parts of the {}, because {}. ", ranking.of, ranking.why_of)
    if best.fit is None:
        return sentence
    if ranking.reached:
        sentence += text(
            "<strong>{}</strong>, {}, is the cheapest within {} of the {}: {} rms held out, {} at most, {} "
            "floating-point operations an evaluation.",
            best.law.name,
            formula_markup(best.law.formula),
            percent(TARGET),
            ranking.of,
            percent(best.held_out_rms),
            percent(best.held_out_max),
            best.fit.operations,
        )
    else:
        sentence += text(
            "None reaches {} of the {}; the best, <strong>{}</strong>, {}, has {} rms held out.{}",
            percent(TARGET),
            ranking.of,
            best.law.name,
            formula_markup(best.law.formula),
            percent(best.held_out_rms),
            " The co-energy below is the model to use here." if has_coenergy else "",
        )
    return sentence


def _ranking_table(ranking: Ranking) -> DataTable:
    header = (
        "law",
        "formula",
        "operations",
        "parameters",
        "held-out rms",
        "held-out max",
        "held-out of the force",
        "all rows",
    )
    return DataTable(
        text("Candidates, best first; errors in per cent of the {}, but one column of the force itself", ranking.of),
        header,
        tuple(_candidate_row(c) for c in ranking.candidates),
    )


def _candidate_row(c: Candidate) -> tuple[str, ...]:
    if c.fit is None:
        return (c.law.name, formula_markup(c.law.formula), f"not fitted: {c.failure}", "", "", "", "", "")
    return (
        c.law.name,
        formula_markup(c.law.formula),
        str(c.fit.operations),
        str(c.parameters),
        percent(c.held_out_rms),
        percent(c.held_out_max),
        percent(c.held_out_of_force),
        percent(c.rms),
    )


def _term_table(fit: LawFit, content: ReportContent) -> DataTable:
    rows: list[tuple[str, ...]] = []
    for n, (basis, power) in enumerate(fit.terms):
        unit = fit.law.coefficient_units[fit.law.basis.index(basis)] + (f" A^-{power}" if power else "")
        low, high = fit.interval.block[n]
        term = formula_markup(basis) + (
            "" if power == 0 else text(" i") if power == 1 else text(" i<sup>{}</sup>", power)
        )
        rows.append(
            (
                term,
                significant(float(fit.joint.x[n]), 5),
                f"{significant(float(low), 4)} … {significant(float(high), 4)}",
                formula_markup(unit),
            )
        )
    units = {parameter.name: parameter.unit for parameter in fit.law.shape}
    for name, value in fit.shape.items():
        low, high = fit.shape_interval[name]
        rows.append((name, significant(value, 5), f"{significant(low, 4)} … {significant(high, 4)}", units[name]))
    return DataTable(
        text(
            "Coefficients of {}, with 95 % intervals (jackknife over blocks of distances), for {} to {} mm and {} to "
            "{} A",
            fit.law.name,
            plain(1e3 * content.fit.rows.distances[0]),
            plain(1e3 * content.fit.rows.distances[-1]),
            plain(content.fit.rows.currents[0]),
            plain(content.fit.rows.currents[-1]),
        ),
        ("term", "value", "95 % interval", "unit"),
        tuple(rows),
    )


def _coenergy(fit: CoenergyFit, misfit: Misfit) -> Block:
    flux = (
        ""
        if misfit.flux_linkage_rms_Wb is None
        else f", and the flux linkage within {quantity(misfit.flux_linkage_rms_Wb, 'Wb')} rms"
    )
    weight = "" if misfit.force_rms_of_weight is None else f" ({percent(misfit.force_rms_of_weight)} of the weight)"
    constraints = "; ".join(SHAPES[name].replace(">=", "≥").replace("k_m", "∂F/∂i") for name in fit.constraints)
    declared = f" Shape constraints: {constraints}." if constraints else ""
    return text(
        "The reference is one co-energy W′(d, i), a spline of {} coefficients fitted to force and flux linkage "
        "together, so that force, flux linkage, motional constant and inductance cannot contradict each other. It "
        "meets the sweep's force within {} rms, {} of the force{}{}.{}",
        int(np.prod(fit.basis.shape)),
        quantity(misfit.force_rms_N, "N"),
        percent(misfit.force_rms_relative),
        weight,
        flux,
        declared,
    )


def _residuals(content: ReportContent, best: LawFit) -> Picture:
    rows = content.fit.rows
    shown = {fit.law.name: fit for fit in (content.law("F1e"), best) if fit is not None}
    forces = [(name, law_force(fit, rows)) for name, fit in shown.items()]
    if content.fit.coenergy is not None:
        forces.append(("co-energy", content.fit.coenergy.magnetics.force(rows.distance, rows.current)))
    return Picture(
        "residuals",
        svg_uri(residual_figure(rows, forces), "residuals"),
        f"Maps of fitted minus solved force for {', '.join(name for name, _ in forces)}.",
        Markup("Fitted minus solved force over distance and current. Each map has its own scale."),
    )
