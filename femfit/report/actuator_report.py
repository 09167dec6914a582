"""The report on an actuator: which chapters its kind asks for, and the numbers and figures in them."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np

from femfit.core.numerics import GRAVITY
from femfit.core.text import axis_scale
from femfit.device.electrics import REMEDY, where_clipped
from femfit.device.parts import Actuator
from femfit.fit.coenergy import SHAPES
from femfit.fit.constants import TARGET
from femfit.fit.rows import FitRows
from femfit.model.several_magnetics import NETWORK, OPERATIONS
from femfit.report.cutaway import draw_off_screen
from femfit.report.drawing import USUAL_KNEES, iron_loads, material_words
from femfit.report.field_figures import line_flux
from femfit.report.field_sample import FieldSample
from femfit.report.figures import figures_of
from femfit.report.model_figures import SweepGrid
from femfit.report.page import ReportContent, hangs, render
from femfit.report.style import data_uri, svg_uri
from femfit.simulation.design import CONTROLLERS
from femfit.simulation.margins import worst_of
from femfit.simulation.summary import FILTER
from femfit.simulation.words import sentence

Draw = Callable[[Actuator, FieldSample], tuple[bytes | None, str]]

DRAWN_WITH = ("numpy", "scipy", "matplotlib", "pyvista", "jinja2")

_OF_CONTENT = ("model", "actuator", "rows", "weight", "motion", "heat", "feeds", "study")
"""What templates call by its own name."""

_CONSTANTS: dict[str, Any] = {
    "shapes": SHAPES,
    "target": TARGET,
    "network_name": NETWORK,
    "network_operations": OPERATIONS,
    "all_controllers": CONTROLLERS,
    "filter": FILTER,
    "worst_of": worst_of,
    "loop_words": partial(sentence, "loop"),
}

CUTAWAY, NO_CUTAWAY = "cutaway", "why there is no cut-away"


def draw_figures(content: ReportContent, draw: Draw = draw_off_screen) -> dict[str, str]:
    """Draw what a report shows and is not drawn yet, as data URIs by name."""
    pictures = dict(content.pictures)
    with ThreadPoolExecutor(1) as beside:  # the cut-away has a process of its own
        cutaway = None
        if content.actuator is not None and content.field is not None and CUTAWAY not in pictures:
            cutaway = beside.submit(draw, content.actuator, content.field)
        pictures |= {name: svg_uri(make, name) for name, make in figures_of(content).items() if name not in pictures}
        if cutaway is not None:
            image, pictures[NO_CUTAWAY] = cutaway.result()
            pictures[CUTAWAY] = "" if image is None else data_uri("image/png", image)
    return pictures


def render_report(content: ReportContent, figures: Mapping[str, str]) -> str:
    """The report as HTML text with pictures from :func:`draw_figures`."""
    ranking = content.fit and content.fit.ranking
    model, actuator, rows, strongest = content.model, content.actuator, content.rows, content.strongest
    facts = {
        "title": model.name,
        "lead": "" if actuator is None else actuator.description,
        "content": content,
        **{name: getattr(content, name) for name in _OF_CONTENT},
        **{name: getattr(model, name) for name in ("misfit", "validity")},
        "levitates": hangs(actuator, rows),
        "several": content.together,
        "circuit_names": [] if actuator is None else [circuit.name for circuit in actuator.circuits],
        "iron": () if actuator is None or strongest is None else iron_loads(actuator, strongest.part_flux_density_T),
        "usual_knees": USUAL_KNEES,
        "drawing": None if actuator is None else _drawing_facts(content, actuator),
        "line_flux_Wb": None if content.field is None else line_flux(content.field),
        "sweep": None if rows is None else _sweep_facts(content, rows, content.grid),
        "laws": content.fit if ranking and ranking.recommended.fit else None,
        "coenergy": None if content.fit is None else content.fit.coenergy,
        **_CONSTANTS,
        "hall": _hall_facts(content),
        "travel": model.travel_m,
        "stopped": model.motion is not None and None not in {model.motion.near_stop, model.motion.far_stop},
        "provenance": _provenance(content),
    }
    return render("actuator.html.j2", facts, figures)


def _drawing_facts(content: ReportContent, actuator: Actuator) -> dict[str, Any]:
    table = None if content.sweep is None else content.sweep.valid_rows()
    inductance = None
    if table is not None and "inductance_H" in table and table["inductance_H"].notna().any():
        inductance = float(table["inductance_H"].min()), float(table["inductance_H"].max())
    return {
        "moving_magnet": any(region.material.remanence_T for region in actuator.moving.regions),
        "fixed_magnet": any(region.material.remanence_T for region in actuator.fixed),
        "moving_coil": bool(actuator.coils) and all(coil.moves for coil in actuator.coils),
        "parts": [(region.name, region.material.name, material_words(region)) for region in actuator.regions],
        "inductance_H": inductance,
        "weight_N": actuator.mechanics.mass_kg * GRAVITY,
    }


def _sweep_facts(content: ReportContent, rows: FitRows, grid: SweepGrid | None) -> dict[str, Any]:
    largest = float(np.max(np.abs(rows.force))) or 1.0
    estimated = rows.force_error > 0.0
    factor, unit = axis_scale(rows.force, "N")
    return {
        "combinations": len(np.unique(rows.circuit_currents, axis=0)),
        "failed": 0 if content.sweep is None else len(content.sweep.rows) - len(rows.force),
        "currents": rows.currents.tolist(),
        "distances": rows.distances.tolist(),
        "force_min": float(rows.force.min()),
        "force_max": float(rows.force.max()),
        "error_of_largest": float(rows.force_error.max()) / largest if estimated.any() else None,
        "error_median": float(np.median((rows.force_error / rows.force_scale)[estimated])) if estimated.any() else None,
        "grid": grid,
        "unit": unit,
        "factor": factor,
        "largest": largest,
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
    of_circuits = []
    for name, slope in zip(names, slopes.T, strict=True):
        largest = float(slope[np.argmax(np.abs(slope))])
        spread = float(np.ptp(slope)) / abs(largest) if largest else 0.0  # over the distance
        of_circuits.append({"circuit": name, "T_per_A": largest, "spread": spread})
    places, currents = box.grid(41, 15, several=5)
    return {
        "sensor": sensor,
        "clipped": where_clipped(sensor, places, sensor.field.field(places, currents)),
        "remedy": REMEDY,
        "near_m": float(d[0]),
        "far_m": float(d[-1]),
        "near_T": float(idle[0]),
        "far_T": float(idle[-1]),
        "slopes": of_circuits,
        "shown": content.rows is not None and content.rows.hall is not None and content.together is None,
        "misfit_T": None if content.model.misfit is None else content.model.misfit.hall_rms_T,
    }


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
