"""The report's section on the field."""

import numpy as np

from femfit.report.content import ReportContent
from femfit.report.embed import svg_uri
from femfit.report.field_figure import field_figure, flux_levels
from femfit.report.field_sample import FieldSample
from femfit.report.numbers import percent, plain, quantity
from femfit.report.section import Picture, Section, text

MM = 1e3


def field_section(content: ReportContent, sample: FieldSample, no_cutaway: str | None) -> Section:
    """|B| and flux lines at one point.

    Parameters
    ----------
    no_cutaway : str or None
        Why there is no three-dimensional view; None where there is one.
    """
    where = text("d = {} mm and i = {} A", plain(MM * sample.distance_m, 4), plain(sample.current_A, 3))
    weight = content.fit.rows.hanging_weight
    share = "" if weight is None else f", {percent(sample.force_N / weight, 3)} of the weight"
    parts = ", ".join(f"{name.replace('_', ' ')} {quantity(b, 'T')}" for name, b in sample.part_flux_density_T.items())
    levels = flux_levels(sample.flux_Wb)
    blocks = (
        text(
            "At {} the force is {}{}. The largest |B| in each part, its corners left out: {}.",
            where,
            quantity(sample.force_N, "N"),
            share,
            parts,
        ),
        Picture(
            "field",
            svg_uri(field_figure(content.actuator, sample), "field"),
            f"Map of the flux density with flux lines over the full section at {MM * sample.distance_m:.3g} mm.",
            text(
                "|B| at {}, with flux lines. Between neighbouring lines flows the same flux, {}. Colours are "
                "logarithmic. Drawn by matplotlib from {} points of the finite-element solution ({} unknowns).{}",
                where,
                quantity(float(np.diff(levels).min()), "Wb", 2),
                f"{sample.flux_density_T.size:,}".replace(",", "\u2009"),
                f"{sample.unknowns:,}".replace(",", "\u2009"),
                "" if no_cutaway is None else f" There is no three-dimensional view: {no_cutaway}.",
            ),
        ),
    )
    return Section("field", "The field", blocks)
