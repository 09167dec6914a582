"""The report's section on the paper's force laws, and why they fit as they do."""

import numpy as np
from markupsafe import Markup

from femfit.core.arrays import FloatArray
from femfit.fit.law_fit import LawFit
from femfit.fit.ranking import TARGET
from femfit.report.candidates_figure import (
    exponent_figure,
    law_force,
    local_exponents,
)
from femfit.report.content import ReportContent
from femfit.report.embed import svg_uri
from femfit.report.formula import formula_markup
from femfit.report.numbers import NO_BREAK, percent, plain, significant
from femfit.report.paper import A_N_M4, M_N_M2_PER_A, TURNS, is_papers
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.report.two_stage_figures import coefficient_figure, curve_fit_figure, residual_sums_figure

PAPER_LAWS = ("F1e", "F2e")


def paper_laws_section(content: ReportContent) -> Section | None:
    """F1e and F2e in two stages, and why they fit as they do."""
    fits = [fit for fit in (content.law(name) for name in PAPER_LAWS) if fit is not None]
    if not fits:
        return None
    rows = content.fit.rows
    blocks: list[Block] = [
        text(
            "The paper fits {} at each current by itself, then each coefficient as a function of the current. The "
            "same two stages on this sweep, by a bounded quadratic programme with coefficients ≥ 0{}:",
            Markup(" and ").join(text("{} = {}", fit.law.name, formula_markup(fit.law.formula)) for fit in fits),
            " at positive currents" if content.fit.rows.currents[0] < 0 else "",
        ),
        Picture(
            "law-curves",
            svg_uri(curve_fit_figure(fits, rows), "law-curves"),
            "Force curves of the sweep with the paper's laws and their residuals.",
            Markup(
                "The paper's laws on force curves (Figure 9 of the paper), each curve with its own coefficients. "
                "Below: law minus sweep; mind the different scales."
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
    rows, currents = content.fit.rows, fit.stage_one.currents
    a, b = fit.stage_one.coefficients.T
    sentence = text("Over the currents {}; {}.", _span("a", a, "N m⁴"), _span("b", b, "N m²"))
    pulling = [float(np.ptp(rows.force[rows.current == i])) > 0.0 for i in currents]
    stages = zip(currents, fit.stage_one.solutions, pulling, strict=True)
    on_bound = [i for i, solution, pulls in stages if pulls and any(solution.active)]
    if on_bound:
        where = "every current" if len(on_bound) == sum(pulling) else ", ".join(f"{i:g} A" for i in on_bound)
        sentence += text(
            " At {} a coefficient stands on its bound of zero: without the bound it would be negative.", where
        )
    if is_papers(content.actuator) and a[0] > 0.0:
        turns = content.actuator.coil.turns
        slope = float(b @ currents / (currents @ currents))
        sentence += text(
            " The paper has a = {} N m⁴ at every current and b = m i with m = {} N m²/A for {} turns, {} per turn; a "
            "line through the origin gives {} per turn here ({} turns). Its a is {} of the value at zero current here.",
            significant(A_N_M4, 4),
            significant(M_N_M2_PER_A, 4),
            TURNS,
            significant(M_N_M2_PER_A / TURNS),
            significant(slope / turns),
            plain(turns),
            percent(A_N_M4 / float(a[0]), 3),
        )
    return sentence


def _span(name: str, values: FloatArray, unit: str) -> str:
    if not np.any(values):
        return f"{name} is zero"
    return f"{name} goes from {significant(float(values[0]))} to {significant(float(values[-1]))} {unit}"


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
            "d<sup>−n</sup> with n between 2 and 4. Here {}. {}",
            "F1e not fit" if _worst(content, fit) > TARGET else "F1e fit",
            Markup(", ").join(parts),
            "Any exponent outside of that band is a misfit that no choice of a and b removes: the parts have an "
            "extent, so distances count from inside of them and not from their faces."
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
    return float(np.sqrt(np.mean(error**2)) / rows.error_scale[0])
