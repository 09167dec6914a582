"""Numbers of a drawing that the device does not have: faces, permeabilities and knees, solved anew.

Any drawing of one coil: each face, with what touches it, the Hall element's height, each permeability of iron without a
curve, and the polarisation of each curve. A face moves by up to a 25th of its part's extent, less where parts would
overlap, and only one way where the other cannot be built.
"""

import zlib
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import ActuatorFileError
from femfit.core.numerics import MU_0
from femfit.device.complaints import joined
from femfit.device.drawing import table_at
from femfit.device.drawn_faces import drawn_faces
from femfit.device.file_numbers import Location
from femfit.device.load import actuator_from_tables, parse, read_text
from femfit.device.parts import Actuator, LinearMaterial, NonlinearMaterial
from femfit.trial.field_table import HiddenError
from support.trial.truth import FIELD, Truth, always

STEP = 0.04
"""Largest change, over the extent of the part along that axis, or over the material's number."""

_DEAL = 41
"""Seed by which numbers are dealt out; another one would bring numbers that were used before into the final set."""


@dataclass(frozen=True)
class Number:
    """A number of the file: all places that move together, and its largest change in its unit."""

    places: tuple[Location, ...]
    step: float
    material: str = ""  # Of a curve whose polarisation it is; the change is relative then
    key: str = ""  # Of a face that moves with the slanted edges beside it

    @property
    def names(self) -> tuple[str, ...]:
        """Key paths."""
        paths = [self.key] * bool(self.key) + [joined("", *place) for place in self.places]
        return tuple(dict.fromkeys(paths)) or (f"materials.{self.material}.B_T",)

    def changed(self, data: Mapping[str, Any], change: float, directory: Path) -> Actuator | None:
        """The drawing with this number changed; None if it cannot be built."""
        tables = deepcopy(dict(data))
        tables.pop("sweep")
        tables["sweep"] = {key: value for key, value in data["sweep"].items() if key in ("current_A", "distance_mm")}
        for place in self.places:
            table: Any = tables
            for key in place[:-1]:
                table = table[key]
            table[place[-1]] = round(float(table[place[-1]]) + change, 9)
        try:
            actuator = actuator_from_tables(tables, "changed drawing", directory)
        except ActuatorFileError:
            return None
        return _with_polarisation(actuator, self.material, 1.0 + change) if self.material else actuator


def number_truths(drawing: Path, part: int, parts: int, count: int) -> Mapping[str, Truth]:
    """Up to ``count`` numbers of a drawing, of those that belong to one of ``parts`` disjoint sets."""
    data = parse(read_text(drawing), str(drawing))
    actuator = actuator_from_tables(data, str(drawing), drawing.parent)
    numbers = sorted(_numbers(data, actuator), key=lambda number: number.names)
    order = np.random.default_rng([_DEAL, zlib.crc32(actuator.name.encode())]).permutation(len(numbers))
    truths: dict[str, Truth] = {}
    for number in (numbers[k] for k in order[part::parts]):
        forms = _forms(number, data, drawing.parent, not actuator.saturates)
        if forms and len(truths) < count:
            truths[f"drawing:{number.names[0]}"] = _truth(number, actuator, forms)
    return truths


def _forms(number: Number, data: Mapping[str, Any], directory: Path, linear: bool) -> dict[float, Actuator]:
    """The drawing at two changes of the number, either way if both can be built; at one where iron saturates."""

    def built(*changes):
        forms = {change: number.changed(data, change, directory) for change in changes}
        return {change: form for change, form in forms.items() if form is not None}

    parts = (1.0, 0.5, 0.25) if linear else (0.5, 0.25)  # one solution is taken in part: it must not be far
    steps = [round(number.step * part, 6) for part in parts]
    either_way = [(-step, step) for step in steps[:2]] if linear else []
    one_way = [(sign * step / 2, sign * step)[not linear :] for sign in (1, -1) for step in steps]
    for changes in (*either_way, *one_way):
        forms = built(*changes)
        if len(forms) == len(changes):
            return forms
    return {}


def _truth(number: Number, drawn: Actuator, forms: Mapping[float, Actuator]) -> Truth:
    largest, one_way = max(map(abs, forms)), float(np.sign(sum(forms)))
    resistance = {change: form.coil.resistance_ohm for change, form in {0.0: drawn, **forms}.items()}

    def change(size):
        return one_way * abs(size) if one_way else size

    def reading(device, size, settings, values):
        more = np.interp(change(size), sorted(resistance), [resistance[p] for p in sorted(resistance)])
        return {"voltage_V": values["voltage_V"] + (more - device.actuator.coil.resistance_ohm) * settings.current}

    error = HiddenError(
        lambda device: largest,
        FIELD,
        fields=lambda device, size, settings: device.change(number.names[0], change(size), settings),
        reading=reading,
        names=number.names,
    )
    return always(error, "drawing", families=lambda actuator: {number.names[0]: forms})


def _numbers(data: Mapping[str, Any], actuator: Actuator) -> Iterator[Number]:
    faces = drawn_faces(data)
    replaced = {face.flat for face in faces if face.key}
    for face in faces:
        if face.locations[0] not in replaced:
            yield Number(face.locations, STEP * _extent(data, face.locations[0]), key=face.key)
    if "z_mm" in table_at(data, "hall"):
        yield Number((("hall", "z_mm"),), 0.5)
    for name, table in table_at(data, "materials").items():
        permeability = float(table.get("relative_permeability", 1.0))
        if permeability > 10.0:
            yield Number((("materials", name, "relative_permeability"),), 5.0 * STEP * permeability)
    regions = (*actuator.fixed, *actuator.moving.regions)
    materials = [region.material for region in regions]
    for name in sorted({material.name for material in materials if isinstance(material, NonlinearMaterial)}):
        yield Number((), 2.0 * STEP, material=name)


def _extent(data: Mapping[str, Any], location: Location) -> float:
    """Of the part that a coordinate belongs to, along its axis, in mm."""
    outline: Any = data
    for key in location:
        if isinstance(key, int):
            break
        outline = outline[key]
    if "circle_mm" in location:
        return float(outline[2])
    values = [corner[location[-1]] for corner in outline] if "polygon_mm" in location else outline
    return float(np.ptp(values))


def _with_polarisation(actuator: Actuator, name: str, factor: float) -> Actuator:
    """A curve with ``factor`` times its polarisation J = B - mu_0 H at each field: another knee."""

    def changed(region):
        material = region.material
        if isinstance(material, LinearMaterial) or material.name != name:
            return region
        h, b = np.array(material.field_A_per_m), np.array(material.flux_density_T)
        b = MU_0 * h + factor * (b - MU_0 * h)
        return replace(region, material=replace(material, flux_density_T=tuple(b.tolist())))

    moving = replace(actuator.moving, regions=tuple(map(changed, actuator.moving.regions)))
    return replace(actuator, fixed=tuple(map(changed, actuator.fixed)), moving=moving)
