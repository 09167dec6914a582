"""The report's section on force laws: the paper's, why they do not fit, and which one does."""

import numpy as np
from markupsafe import Markup

from femfit.fit.coenergy import SHAPES, CoenergyFit
from femfit.fit.law_fit import LawFit
from femfit.fit.misfit import misfit_to_rows
from femfit.fit.ranking import TARGET, Candidate, Ranking
from femfit.model.actuator_model import Misfit
from femfit.report.candidates_figure import (
    exponent_figure,
    law_force,
    local_exponents,
    ranking_figure,
    residual_figure,
)
from femfit.report.content import ReportContent
from femfit.report.embed import svg_uri
from femfit.report.formula import formula_markup
from femfit.report.numbers import NO_BREAK, percent, plain, quantity, significant
from femfit.report.paper import A_N_M4, M_N_M2_PER_A, TURNS, is_papers
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.report.sweep_grid import sweep_grid
from femfit.report.two_stage_figures import coefficient_figure, curve_fit_figure, residual_sums_figure

PAPER_LAWS = ("F1e", "F2e")


def coenergy_misfit(content: ReportContent) -> Misfit | None:
    """How far the co-energy is from the sweep; None where there is none."""
    fit = content.fit.coenergy
    return None if fit is None else misfit_to_rows(fit.magnetics, content.fit.rows)


def paper_laws_section(content: ReportContent) -> Section | None:
    """F1e and F2e in two stages, and why they fit as they do.

    Parameters
    ----------
    content : ReportContent
        Any.

    Returns
    -------
    Section or None
        None where neither was fitted.
    """
    fits = [fit for fit in (content.law(name) for name in PAPER_LAWS) if fit is not None]
    if not fits:
        return None
    rows = content.fit.rows
    blocks: list[Block] = [
        text(
            "The paper fits {} at each current by itself, then each coefficient as a function of the current. The same "
            "two stages on this sweep, by a bounded quadratic programme with coefficients ≥ 0:",
            Markup(" and ").join(text("{} = {}", fit.law.name, formula_markup(fit.law.formula)) for fit in fits),
        ),
        Picture(
            "law-curves",
            svg_uri(curve_fit_figure(fits, rows), "law-curves"),
            "Force curves of the sweep with the paper's laws and their residuals.",
            Markup(
                "The paper's laws on force curves (Figure 9 of the paper), each curve with its own coefficients. "
                "Below: "
                "law minus sweep; mind the different scales."
            ),
        ),
        Picture(
            "residual-sums",
            svg_uri(residual_sums_figure(fits), "residual-sums"),
            "Sum of squared residuals over current for the paper's laws.",
            Markup("Sum of squared residuals at each current (Figure 8 of the paper)."),
        ),
        _stage_one_table(fits),
    ]
    first = fits[0]
    if first.law.name == "F1e":
        blocks.append(_coefficients(content, first))
    blocks.append(
        Picture(
            "coefficient-functions",
            svg_uri(coefficient_figure(first), "coefficient-functions"),
            f"Coefficients of {first.law.name} over current with fitted functions.",
            text(
                "Coefficients of {} at each current, and the functions chosen by leaving out one current at a time "
                "(Figure 10 of the paper).",
                first.law.name,
            ),
        )
    )
    blocks += _why(content, first)
    return Section("paper-laws", "The paper's force laws on these data", tuple(blocks))


def _stage_one_table(fits: list[LawFit]) -> DataTable:
    symbols = iter("abcdefgh")
    header = ["current"]
    for n, fit in enumerate(fits, start=1):
        for basis, unit in zip(fit.law.basis, fit.law.coefficient_units, strict=True):
            header.append(text("{} of {} ({})", next(symbols), formula_markup(basis), formula_markup(unit)))
        header.append(text("J<sub>{}</sub> (N²)", n))
    table = []
    for k, current in enumerate(fits[0].stage_one.currents):
        cells = [f"{plain(float(current))}{NO_BREAK}A"]
        for fit in fits:
            cells += [significant(float(value), 4) for value in fit.stage_one.coefficients[k]]
            cells.append(significant(float(fit.stage_one.residual_sums[k]), 3))
        table.append(tuple(cells))
    return DataTable(Markup("Stage one at each current (Table 3 of the paper)"), tuple(header), tuple(table))


def _coefficients(content: ReportContent, fit: LawFit) -> Block:
    a, b = fit.stage_one.coefficients.T
    sentence = text(
        "Of the coefficients, a changes from {} to {} N m⁴ over the currents and b from {} to {} N m².",
        significant(float(a[0])),
        significant(float(a[-1])),
        significant(float(b[0])),
        significant(float(b[-1])),
    )
    on_bound = [
        f"{current:g} A"
        for current, s in zip(fit.stage_one.currents, fit.stage_one.solutions, strict=True)
        if any(s.active)
    ]
    if on_bound:
        sentence += text(
            " At {} a coefficient stands on its bound of zero: without the bound it would change its sign there.",
            ", ".join(on_bound),
        )
    if is_papers(content.actuator):
        turns = content.actuator.coil.turns
        slope = float(b @ fit.stage_one.currents / (fit.stage_one.currents @ fit.stage_one.currents))
        sentence += text(
            " The paper has a = {} N m⁴ at every current and b = m i with m = {} N m²/A for {} turns, {} per turn; a "
            "line "
            "through the origin gives {} per turn here ({} turns). Its a is {} of the value at zero current here.",
            significant(A_N_M4, 4),
            significant(M_N_M2_PER_A, 4),
            TURNS,
            significant(M_N_M2_PER_A / TURNS),
            significant(slope / turns),
            plain(turns),
            percent(A_N_M4 / float(a[0]), 3),
        )
    return sentence


def _why(content: ReportContent, fit: LawFit) -> list[Block]:
    coenergy, rows = content.fit.coenergy, content.fit.rows
    if coenergy is None:
        return []
    exponents = local_exponents(coenergy.magnetics, rows)
    if not exponents:
        return []
    parts = [
        text(
            "the {} falls like d<sup>−n</sup> with n from {} to {}",
            name.split(" F(")[0].split(" ∂")[0],
            plain(float(n[0]), 3),
            plain(float(n[-1]), 3),
        )
        for name, (_, n) in exponents.items()
    ]
    return [
        text(
            "Why does {}? A sum of d<sup>−4</sup> and d<sup>−2</sup> with positive coefficients can only fall like "
            "d<sup>−n</sup> "
            "with n between 2 and 4. Here {}. {}",
            "F1e not fit" if _worst(content, fit) > TARGET else "F1e fit",
            Markup(", ").join(parts),
            "Any exponent outside of that band is a misfit that no choice of a and b removes: the magnet and the "
            "pole have "
            "an extent, so distances count from inside of them and not from their faces."
            if any(np.min(n) < 2.0 or np.max(n) > 4.0 for _, n in exponents.values())
            else "That lies within the band.",
        ),
        Picture(
            "exponents",
            svg_uri(exponent_figure(exponents), "exponents"),
            "Local exponent of the force over distance.",
            Markup(
                "The exponent by which the force falls, from the co-energy. A law of one power would be a horizontal "
                "line."
            ),
        ),
    ]


def _worst(content: ReportContent, fit: LawFit) -> float:
    rows = content.fit.rows
    error = law_force(fit, rows) - rows.force
    return float(np.sqrt(np.mean(error**2)) / (rows.weight or np.sqrt(np.mean(rows.force**2))))


def candidates_section(content: ReportContent) -> Section | None:
    """The candidates ranked, residual maps, the recommended law, the co-energy.

    Parameters
    ----------
    content : ReportContent
        Any.

    Returns
    -------
    Section or None
        None without a ranking.
    """
    ranking = content.fit.ranking
    if ranking is None or ranking.recommended.fit is None:
        return None
    best = ranking.recommended.fit
    blocks: list[Block] = [
        _recommendation(ranking),
        Picture(
            "ranking",
            svg_uri(ranking_figure(ranking), "ranking"),
            "Held-out error of each candidate law over its floating-point operations.",
            Markup("Each candidate's error on rows that it was not fitted to, against its cost. Ringed: recommended."),
        ),
        _ranking_table(ranking),
        _term_table(best, content),
    ]
    if content.fit.coenergy is not None:
        blocks.append(_coenergy(content.fit.coenergy, misfit_to_rows(content.fit.coenergy.magnetics, content.fit.rows)))
    if sweep_grid(content.fit.rows) is not None:
        blocks.append(_residuals(content, best))
    return Section("candidates", "Which law does", tuple(blocks))


def _recommendation(ranking: Ranking) -> Block:
    best = ranking.recommended
    fitted = [c for c in ranking.candidates if c.fit is not None]
    sentence = text(
        "{} laws were ranked by their error on held-out rows (blocks of neighbouring distances, single currents). ",
        len(fitted),
    )
    if best.fit is None:
        return sentence
    if ranking.reached:
        sentence += text(
            "<strong>{}</strong>, {}, is the cheapest within {} of the {}: {} rms held out, {} at most, {} "
            "floating-point "
            "operations an evaluation.",
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
            "None reaches {} of the {}; the best, <strong>{}</strong>, {}, has {} rms held out. The co-energy below "
            "is the "
            "model to use here.",
            percent(TARGET),
            ranking.of,
            best.law.name,
            formula_markup(best.law.formula),
            percent(best.held_out_rms),
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
                significant(float(fit.two_stage[n]), 5),
                significant(float(fit.joint.x[n]), 5),
                f"{significant(float(low), 4)} … {significant(float(high), 4)}",
                formula_markup(unit),
            )
        )
    units = {parameter.name: parameter.unit for parameter in fit.law.shape}
    for name, value in fit.shape.items():
        low, high = fit.shape_interval[name]
        rows.append((name, significant(value, 5), "", f"{significant(low, 4)} … {significant(high, 4)}", units[name]))
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
        ("term", "two stages", "one stage", "95 % interval of the one stage", "unit"),
        tuple(rows),
    )


def _coenergy(fit: CoenergyFit, misfit: Misfit) -> Block:
    flux = (
        ""
        if misfit.flux_linkage_rms_Wb is None
        else f", and the flux linkage within {quantity(misfit.flux_linkage_rms_Wb, 'Wb')} rms"
    )
    weight = "" if misfit.force_rms_of_weight is None else f" ({percent(misfit.force_rms_of_weight)} of the weight)"
    constraints = "; ".join(SHAPES[name] for name in fit.constraints)
    declared = f" Shape constraints: {constraints}." if constraints else ""
    return text(
        "The reference is one co-energy W′(d, i), a spline of {} coefficients fitted to force and flux linkage "
        "together, so "
        "that force, flux linkage, motional constant and inductance cannot contradict each other. It meets the "
        "sweep's force "
        "within {} rms, {} of the force{}{}.{}",
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
