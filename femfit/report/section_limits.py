"""The report's sections on what it does not show, and on where its numbers come from."""

from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from markupsafe import Markup

from femfit.device.parts import LinearMaterial
from femfit.report.content import ReportContent
from femfit.report.kinds import IRON_FROM, has_magnet
from femfit.report.numbers import plain, quantity
from femfit.report.section import Block, DataTable, Section, text

DRAWN_WITH = ("matplotlib", "pyvista", "jinja2")


def limits_section(content: ReportContent) -> Section:
    """What was not shown."""
    points = [_materials(content)]
    if has_magnet(content.actuator):
        points.append(
            Markup(
                "Remanence and recoil permeability are those of the file; a magnet's grade scatters by some per cent "
                "and falls with temperature."
            )
        )
    points += [
        Markup(
            "The error estimates are of the discretisation: they say nothing of dimensions, materials or turns that "
            "differ from the drawing."
        ),
        Markup(
            "The problem is axisymmetric and static: no tilt, no sideways offset, no eddy currents, no hysteresis, no "
            "leads."
        ),
        _validity(content),
    ]
    if content.study is not None:
        points.append(
            Markup(
                "The loop is simulated on the same model that filter and controllers use, but where a fault is named; "
                "the sensor's noise is white; nothing here was measured on a bench."
            )
        )
    elif content.fit.model.sensor is None:
        points.append(
            Markup("Without a Hall element the position cannot be measured as in the paper, and no loop was simulated.")
        )
    items = Markup("").join(text("<li>{}</li>", point) for point in points)
    return Section("limits", "What this does not show", (text("<ul>{}</ul>", items),))


def _materials(content: ReportContent) -> Markup:
    sample = content.field
    regions = (*content.actuator.fixed, *content.actuator.moving.regions)
    curved = dict.fromkeys(r.material.name for r in regions if not isinstance(r.material, LinearMaterial))
    linear = "All materials are linear: nothing saturates."
    if curved:
        linear = f"Of the materials {', '.join(curved)} saturates along its B-H curve, without hysteresis."
    if sample is None:
        return text("{}", linear)
    iron = {r.name for r in regions if not r.material.remanence_T and r.material.relative_permeability >= IRON_FROM}
    found = {name: b for name, b in sample.part_flux_density_T.items() if name in iron}
    if not found:
        return text("{}", linear)
    worst = max(found, key=lambda name: found[name])
    return text(
        "{} At the point drawn above ({} mm, {} A) the iron carries at most {} ({}, corners left out); compare that "
        "with your material's knee.",
        linear,
        plain(1e3 * sample.distance_m, 4),
        plain(sample.current_A, 3),
        quantity(found[worst], "T"),
        worst.replace("_", " "),
    )


def _validity(content: ReportContent) -> Markup:
    box = content.fit.model.validity
    return text(
        "Laws and model hold for {} to {} mm and {} to {} A; outside, femfit refuses to extrapolate.",
        plain(1e3 * box.distance_min_m),
        plain(1e3 * box.distance_max_m),
        plain(box.current_min_A),
        plain(box.current_max_A),
    )


def provenance_section(content: ReportContent) -> Section:
    """Versions, settings, hashes, times."""
    manifest = content.sweep.manifest
    blocks: list[Block] = [_versions(content)]
    settings = _flat(manifest.get("settings"))
    if settings:
        blocks.append(DataTable(Markup("Settings of the field solver"), (), settings))
    hashes = content.hashes
    if manifest.get("configuration_hash"):
        hashes = (("sweep configuration", str(manifest["configuration_hash"])), *hashes)
    if hashes:
        rows = tuple((name, text("<code>{}</code>", value)) for name, value in hashes)
        blocks.append(DataTable(Markup("SHA-256"), (), rows))
    if content.timings_s:
        times = tuple((name, quantity(seconds, "s")) for name, seconds in content.timings_s)
        blocks.append(DataTable(Markup("Time taken"), (), times))
    if content.fit.notes:
        blocks.append(text("Notes of the fit: {}", " ".join(content.fit.notes)))
    return Section("provenance", "Where the numbers come from", tuple(blocks))


def _versions(content: ReportContent) -> DataTable:
    found = {str(name): str(value) for name, value in (content.sweep.manifest.get("versions") or {}).items()}
    found |= {str(name): str(value) for name, value in (content.fit.model.provenance.get("versions") or {}).items()}
    found |= {name: version(name) for name in DRAWN_WITH}
    return DataTable(Markup("Versions"), (), tuple(sorted(found.items())))


def _flat(settings: Mapping[str, Any] | None) -> tuple[tuple[str, str], ...]:
    return tuple((name.replace("_", " "), str(value)) for name, value in (settings or {}).items())
