"""The report on an actuator: which chapters its kind asks for, and the numbers and figures in them."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np

from femfit.audit.carried import COLD_C, WARM_C, carried_range
from femfit.core.numerics import GRAVITY, FloatArray
from femfit.core.text import axis_scale
from femfit.device.drawn_numbers import in_picture
from femfit.device.electrics import REMEDY, where_clipped
from femfit.device.parts import Actuator
from femfit.fit.coenergy import SHAPES
from femfit.fit.constants import TARGET
from femfit.fit.ranking import Ranking
from femfit.fit.rows import FitRows
from femfit.model.actuator_model import ActuatorModel
from femfit.model.network_magnetics import NETWORK, OPERATIONS
from femfit.report.circuits import circuits_figure, current_ranges
from femfit.report.cutaway import draw_off_screen
from femfit.report.drawing import actuator_figure, material_words
from femfit.report.field_cells import FieldSample
from femfit.report.field_figures import field_figure, line_flux
from femfit.report.force_figures import (
    changes_sign,
    coil_figure,
    force_curves_figure,
    force_map_figure,
    stroke_figure,
)
from femfit.report.loop_report import loop_facts, loop_figures
from femfit.report.model_figures import hall_figure, ranking_figure, residual_figure
from femfit.report.motion_figures import open_loop_figure
from femfit.report.page import ReportContent, render
from femfit.report.rating import (
    SMALL,
    USUAL_KNEES,
    SweepGrid,
    copper_share,
    growth,
    iron_loads,
    reciprocity,
)
from femfit.report.style import Drawing, data_uri, svg_uri

Draw = Callable[[Actuator, FieldSample], tuple[bytes | None, str]]

DRAWN_WITH = ("numpy", "scipy", "matplotlib", "pyvista", "jinja2")

_OF_CONTENT = ("model", "actuator", "rows", "weight", "levitates", "motion", "heat", "rating", "unfinished")
"""What templates call by its own name."""

CUTAWAY, NO_CUTAWAY = "cutaway", "why there is no cut-away"


def draw_figures(
    content: ReportContent, draw: Draw = draw_off_screen, drawn: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Draw what a report shows, as data URIs by name; the cut-away is drawn beside the other pictures."""
    pictures = dict(drawn or {})
    actuator, sample = content.actuator, content.field
    with ThreadPoolExecutor(1) as background:
        cutaway = None
        if actuator is not None and sample is not None and CUTAWAY not in pictures:
            cutaway = background.submit(draw, actuator, sample)
        for name, make in _figures(content).items():
            if name not in pictures:
                pictures[name] = svg_uri(make, name)
        if cutaway is not None:
            image, pictures[NO_CUTAWAY] = cutaway.result()
            pictures[CUTAWAY] = "" if image is None else data_uri("image/png", image)
    return pictures


def render_report(content: ReportContent, figures: Mapping[str, str]) -> str:
    """The report as HTML text with pictures from :func:`draw_figures`."""
    return render("actuator.html.j2", _facts(content), figures)


def _facts(content: ReportContent) -> dict[str, Any]:
    model, actuator, rows, grid = content.model, content.actuator, content.rows, content.grid
    iron = () if actuator is None or content.strongest is None else iron_loads(actuator, content.strongest)
    return {
        "title": model.name,
        "lead": "" if actuator is None else actuator.description,
        "content": content,
        **{name: getattr(content, name) for name in _OF_CONTENT},
        **{name: getattr(model, name) for name in ("misfit", "validity")},
        "several": content.together,
        "circuit_names": [] if actuator is None else [circuit.name for circuit in actuator.circuits],
        "limits": model.validity.current_limits_A.tolist(),
        "ranges": " and ".join(current_ranges(model)),
        "copper_share": None if actuator is None else copper_share(actuator),
        "iron": iron,
        "growth": growth(model, content.strongest.current_A) if iron and content.strongest else None,
        "carried": _carried(model),
        "usual_knees": USUAL_KNEES,
        "drawing": None if actuator is None else _drawing_facts(content, actuator),
        "line_flux_Wb": None if content.field is None else line_flux(content.field),
        "sweep": None if rows is None else _sweep_facts(content, rows, grid),
        "laws": _law_facts(content, rows),
        "coenergy": None if content.fit is None else content.fit.coenergy,
        "shapes": SHAPES,
        "hall": _hall_facts(content),
        "closed_loop": None if content.study is None else loop_facts(content.study),
        "travel": model.travel_m,
        "stopped": model.motion is not None and None not in {model.motion.near_stop, model.motion.far_stop},
        "provenance": _provenance(content),
    }


def _figures(content: ReportContent) -> Mapping[str, Drawing]:
    model, actuator, rows = content.model, content.actuator, content.rows
    figures: dict[str, Drawing] = {}
    grid, several, rating = content.grid, content.together, content.rating
    if actuator is not None:
        distance = content.field.distance_m if content.field else float(np.median(actuator.sweep.distances_m))
        signatures = content.sweep.signatures if content.sweep is not None else None
        numbers = in_picture(signatures.numbers) if signatures is not None else ()
        figures["actuator"] = partial(actuator_figure, actuator, distance, numbers=numbers)
        if content.field is not None:
            figures["field"] = partial(field_figure, actuator, content.field)
    if rating is not None:
        figures["stroke"] = partial(stroke_figure, rating, model.motion)
        figures["coil"] = partial(coil_figure, rating)
    if content.motion is not None:
        figures["motion"] = partial(open_loop_figure, content.motion)
    if grid is not None:
        weight = content.weight if content.levitates else None
        figures["force-curves"] = partial(force_curves_figure, grid, weight)
        if grid.is_plane:
            figures["force-map"] = partial(force_map_figure, grid, weight)
    if several is not None:
        weight = content.weight if content.levitates else None
        figures["force-curves"] = partial(force_curves_figure, several.grid, weight, differential=True)
        figures["force-map"] = partial(force_map_figure, several.grid, weight, differential=True)
        figures["circuits"] = partial(circuits_figure, several)
    ranking = None if content.fit is None else content.fit.ranking
    if rows is not None and ranking is not None and ranking.recommended.fit is not None:
        figures["ranking"] = partial(ranking_figure, ranking)
        if grid is not None and grid.is_plane:
            figures["residuals"] = partial(residual_figure, rows, _fitted_forces(content, rows, ranking))
    if rows is not None and rows.hall is not None and model.sensor is not None and several is None:
        figures["hall"] = partial(hall_figure, model, rows)
    if content.study is not None:
        figures |= loop_figures(content.study)
    return figures


def _carried(model: ActuatorModel) -> list[str]:
    """What ``femfit audit`` says of the weight, with a cold and a warm coil."""
    if model.circuit is None or model.motion is None:
        return []
    return list(dict.fromkeys(str(carried_range(model, celsius)) for celsius in (COLD_C, WARM_C)))


def _fitted_forces(content: ReportContent, rows: FitRows, ranking: Ranking) -> list[tuple[str, Any]]:
    best = ranking.recommended.fit
    forces = [] if best is None else [(best.law.name, best.force(best.joint.x, rows.distance, rows.current))]
    return [*forces, ("co-energy", content.model.force(rows.distance, rows.current, extrapolate=True))]


def _drawing_facts(content: ReportContent, actuator: Actuator) -> dict[str, Any]:
    table = None if content.sweep is None else content.sweep.valid_rows()
    inductance = None
    if table is not None and "inductance_H" in table and table["inductance_H"].notna().any():
        inductance = float(table["inductance_H"].min()), float(table["inductance_H"].max())
    return {
        "moving_magnet": any(region.material.remanence_T for region in actuator.moving.regions),
        "fixed_magnet": any(region.material.remanence_T for region in actuator.fixed),
        "moving_coil": bool(actuator.coils) and all(coil.moves for coil in actuator.coils),
        "saturates": actuator.saturates,
        "at_rest": _at_rest(content),
        "parts": [(region.name, region.material.name, material_words(region)) for region in actuator.regions],
        "inductance_H": inductance,
        "weight_N": actuator.mechanics.mass_kg * GRAVITY,
    }


def _at_rest(content: ReportContent) -> str:
    """What happens without current: ``attracted``, ``repelled``, ``both``, ``nothing``, or ``unknown``."""
    rows, idle = content.rows, content.idle
    if rows is None or not np.any(idle):
        return "unknown"
    force = rows.force[idle]
    if np.max(np.abs(force)) <= SMALL * np.max(np.abs(rows.force)):
        return "nothing"
    small = SMALL * np.max(np.abs(force))
    attracted, repelled = bool(force.max() > small), bool(force.min() < -small)
    return "both" if attracted and repelled else "attracted" if attracted else "repelled"


def _sweep_facts(content: ReportContent, rows: FitRows, grid: SweepGrid | None) -> dict[str, Any]:
    largest = float(np.max(np.abs(rows.force))) or 1.0
    estimated = rows.force_error > 0.0
    combined = np.unique(rows.circuit_currents, axis=0)
    facts: dict[str, Any] = {
        "combinations": len(combined),
        "failed": 0 if content.sweep is None else len(content.sweep.rows) - len(rows.force),
        "currents": rows.currents.tolist(),
        "distances": rows.distances.tolist(),
        "force_min": float(rows.force.min()),
        "force_max": float(rows.force.max()),
        "error_of_largest": float(rows.force_error.max()) / largest if estimated.any() else None,
        "error_median": float(np.median((rows.force_error / rows.force_scale)[estimated])) if estimated.any() else None,
        "grid": grid,
        "reciprocity": None if grid is None else reciprocity(grid),
    }
    if grid is not None:
        factor, unit = axis_scale(grid.force, "N")
        facts |= {"unit": unit, "factor": factor, "largest": largest, "changes_sign": changes_sign(grid)}
    return facts


def _law_facts(content: ReportContent, rows: FitRows | None) -> dict[str, Any] | None:
    fit = content.fit
    if fit is None or rows is None or fit.ranking is None or fit.ranking.recommended.fit is None:
        return None
    candidates = fit.ranking.candidates
    return {
        "ranking": fit.ranking,
        "network": fit.network,  # Where it is better than the laws that are ranked
        "network_name": NETWORK,
        "network_operations": OPERATIONS,
        "best": fit.ranking.recommended,
        "fitted": sum(c.fit is not None for c in candidates),
        "target": TARGET,
        "terms": [
            *fit.ranking.recommended.fit.term_rows,
            *(
                (name, 0, value, (low, high), unit)
                for name, value, low, high, unit in fit.ranking.recommended.fit.shape_rows
            ),
        ],
        "failures": fit.ranking.failures,
    }


def _hall_facts(content: ReportContent) -> dict[str, Any] | None:
    """The sensor's characteristic over the distances that the body can have; None without a sensor."""
    sensor, box = content.model.sensor, content.model.validity
    if sensor is None:
        return None
    d = np.linspace(*content.model.travel_m, 41)
    zero = np.clip(0.0, *box.current_limits_A.T)
    names = content.model.circuit_names if len(zero) > 1 else ("",) * len(zero)  # one needs no name
    idle, _, slopes = sensor.field.derivatives(d, np.broadcast_to(zero, (len(d), len(zero))))
    places, currents = box.grid(41, 15, several=5)
    return {
        "sensor": sensor,
        "clipped": where_clipped(sensor, places, currents, sensor.field.field(places, currents)),
        "remedy": REMEDY,
        "near_m": float(d[0]),
        "far_m": float(d[-1]),
        "near_T": float(idle[0]),
        "far_T": float(idle[-1]),
        "slopes": [_hall_slope(name, slope) for name, slope in zip(names, slopes.T, strict=True)],
        "shown": content.rows is not None and content.rows.hall is not None and content.several is None,
        "misfit_T": None if content.model.misfit is None else content.model.misfit.hall_rms_T,
    }


def _hall_slope(circuit: str, slope: FloatArray) -> dict[str, Any]:
    """The largest change of the field with a circuit's current, and how much it differs over the distance."""
    largest = float(slope[np.argmax(np.abs(slope))])
    return {"circuit": circuit, "T_per_A": largest, "spread": float(np.ptp(slope)) / abs(largest) if largest else 0.0}


def _provenance(content: ReportContent) -> dict[str, Any]:
    manifest = {} if content.sweep is None else content.sweep.manifest
    swept, fitted = (record.get("versions") or {} for record in (manifest, content.model.provenance))
    versions = {**{name: version(name) for name in DRAWN_WITH}, **swept, **fitted}
    hashes = list(content.hashes)
    if manifest.get("configuration_hash"):
        hashes.insert(0, ("sweep configuration", str(manifest["configuration_hash"])))
    return {
        "versions": sorted((str(name), str(value)) for name, value in versions.items()),
        "settings": [(name, value) for name, value in (manifest.get("settings") or {}).items() if value is not None],
        "hashes": hashes,
        "notes": () if content.fit is None else content.fit.notes,
    }
