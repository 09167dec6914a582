"""The report's section on the sweep and its accuracy."""

from typing import Any

import numpy as np
from markupsafe import Markup

from femfit.field.sweep_summary import summarise
from femfit.report.content import ReportContent
from femfit.report.embed import svg_uri
from femfit.report.numbers import force_scale, percent, plain, quantity
from femfit.report.section import Block, Picture, Section, text
from femfit.report.sweep_figures import accuracy_figure, changes_sign, force_curves_figure, force_map_figure
from femfit.report.sweep_grid import Reciprocity, SweepGrid, reciprocity, sweep_grid

MM = 1e3


def sweep_section(content: ReportContent) -> Section:
    """Forces over distance and current, and how true they are."""
    rows = content.fit.rows
    failed = len(content.sweep.rows) - len(rows.force)
    blocks: list[Block] = [
        text(
            "{} points: {} currents from {} to {} A, {} distances from {} to {} mm. {} The force lies between {} and "
            "{}.",
            len(rows.force),
            len(rows.currents),
            plain(rows.currents[0]),
            plain(rows.currents[-1]),
            len(rows.distances),
            plain(MM * rows.distances[0]),
            plain(MM * rows.distances[-1]),
            "No point failed." if not failed else f"{failed} points have no result and are left out.",
            quantity(float(rows.force.min()), "N"),
            quantity(float(rows.force.max()), "N"),
        )
    ]
    grid = sweep_grid(rows)
    if grid is None:
        blocks.append(Markup("The points do not fill a grid of currents and distances, so that no curves are drawn."))
        return Section("sweep", "The sweep, and how accurate it is", tuple(blocks))
    table = reciprocity(grid)
    blocks += [*_pictures(content, grid), _accuracy(content, grid)]
    if table is not None:
        blocks.append(_reciprocity(table))
    blocks.append(
        Picture(
            "accuracy",
            svg_uri(accuracy_figure(grid, table), "accuracy"),
            "Estimated discretisation error over distance; motional constant from force and from flux linkage.",
            Markup(
                "Left: each row's own error estimate over its force; steps are where the mesh was made anew. Right: "
                "the motional constant k<sub>m</sub> from two columns of the table that are computed independently."
            )
            if table is not None
            else Markup("Each row's own error estimate over its force."),
        )
    )
    return Section("sweep", "The sweep, and how accurate it is", tuple(block for block in blocks if block))


def _pictures(content: ReportContent, grid: SweepGrid) -> tuple[Picture, Picture]:
    weight = content.weight
    holds = weight is not None and grid.force.min() < weight < grid.force.max()
    axes = "" if changes_sign(grid) else ", on linear and logarithmic axes"
    return (
        Picture(
            "force-curves",
            svg_uri(force_curves_figure(grid, weight), "force-curves"),
            f"Force over distance for each current{axes}.",
            text("Force over distance, a curve a current (Figure 7 of the paper){}.", axes),
        ),
        Picture(
            "force-map",
            svg_uri(force_map_figure(grid, weight), "force-map"),
            "Map of the force over distance and current with contour lines.",
            text(
                "Force over distance and current (Figure 6 of the paper), contour lines in {}.{}",
                force_scale(grid.force)[1],
                " On the red line the force equals the weight: there the body can be held."
                if holds
                else " The weight is reached nowhere in this range."
                if weight is not None and weight >= grid.force.max()
                else "",
            ),
        ),
    )


def _accuracy(content: ReportContent, grid: SweepGrid) -> Block:
    known = grid.force_error > 0.0
    if not np.any(known):
        return Markup("The table gives no estimate of its discretisation error.")
    relative = grid.force_error[known] / grid.force_scale[known]
    sentence = text(
        "Each force carries an estimate of its discretisation error, from two polynomial orders on one mesh: at most "
        "{} of the force (of the force nearby, where it crosses zero), {} in the median.",
        percent(summarise(content.sweep)["force_error_relative_max"]),
        percent(float(np.median(relative))),
    )
    sample = content.field
    if sample is not None and sample.self_force_N:
        sentence += text(
            " The stress of the moving magnet's own field, which should integrate to zero, gives {} on the mesh of "
            "the picture above ({} of the force there); it is computed on each mesh and taken away.",
            quantity(sample.self_force_N, "N"),
            percent(abs(sample.self_force_N / sample.force_N)),
        )
    return sentence


def _reciprocity(table: Reciprocity) -> Any:
    return text(
        "Reciprocity, ∂F/∂i = −∂λ/∂d, ties the force (a stress integral) to the flux linkage λ (an energy): the two "
        "agree within {} of the largest k<sub>m</sub> over the whole table, the numerical derivative included.",
        percent(table.largest_difference),
    )
