"""Three disjoint sets of truths: to calibrate a decision, to develop it, and for the final table.

The effects of the catalogue are in all three, realised by other physics or settings in each; the numbers of a drawing
of one coil are dealt out to them and solved anew.
"""

import re
import zlib
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import takewhile

import numpy as np

from femfit.core.errors import ActuatorFileError, FieldSolverError
from femfit.core.numerics import MU_0
from femfit.device.complaints import joined
from femfit.device.drawing import table_at
from femfit.device.drawn_faces import drawn_faces
from femfit.device.load import actuator_from_tables, parse, read_actuator, read_text
from femfit.device.parts import NonlinearMaterial
from femfit.trial.field_table import HiddenError, solve_drawings
from femfit.trial.hidden import with_materials
from support.trial import magnetics, mechanics, memory, off_axis, readings
from support.trial.truth import BENDS, FIELD, always, only_in_some_runs

SETS = ("calibration", "development", "final")

_LINEAR_NUMBERS, _SATURATING_NUMBERS = 5, 2
"""Numbers of the drawing in each set: a saturating sweep takes ten times as long."""

_WARMTH = ("thermometer", "hot inside", "late")
_MAGNETS = ("scaled", "grade", "shell")
_DRIFT = ("line", "settling", "walk")
_BENDS = tuple(BENDS.values())
_SATURATION = (
    ("first", lambda x: x / (1.0 + x)),  # Froehlich and Kennelly
    ("second", lambda x: x / (1.0 + x**2.5) ** 0.4),
    ("third", lambda x: 2.0 / np.pi * np.arctan(0.5 * np.pi * x)),
)

_TRUTHS = {
    "turns": (magnetics.lost_turns, ("everywhere", "outside", "end")),
    "remanence": (magnetics.weaker_magnets, _MAGNETS),
    "magnet_demagnetisation": (magnetics.demagnetised, ("face", "back", "rim")),
    "core_saturation": (lambda law: magnetics.saturating(*law), _SATURATION),
    "hysteresis": (memory.hysteresis, ("normal relays", "jiles-atherton", "lorentzian relays")),
    "core_remanence": (memory.kept_flux, _BENDS),
    "coil_temperature": (readings.winding, _WARMTH),
    "magnet_temperature": (lambda laws: readings.magnets(*laws), tuple(zip(_MAGNETS, _WARMTH, strict=True))),
    "hall_temperature": (readings.hall_element, _WARMTH),
    "hall_saturation": (readings.hall_saturation, ("tanh", "power", "knee")),
    "hall_drift": (partial(readings.drift, "hall_V"), _DRIFT),
    "flux_integrator_drift": (readings.integrator, ("square", "no reset", "leaky")),
    "lateral_misalignment": (off_axis.beside_the_axis, ("everywhere", "by mount", "tilted")),
    "end_stop_contact": (mechanics.stop, ("ball", "flat", "rubber")),
    "spring": (mechanics.spring, ("straight", "conical", "pretensioned")),
    "spring_in_force": (mechanics.carried_spring, _BENDS),
    "force_drift": (partial(readings.drift, "force_N"), _DRIFT),
    "load_cell_warmth": (readings.load_cell, ("zero", "span", "both")),
    "linkage_friction": (mechanics.friction, ("coulomb", "stribeck", "lugre")),
    "screw": (mechanics.screw, ("sine", "saw", "two gears")),
}
"""By the effect, or the cause: what makes it, and of what in each set."""

_IN_SOME_RUNS = {
    "calibration": ("begins", ("remanence", "resistance", "force_gain", "hall_offset", "distance_offset")),
    "development": ("ends", ("turns", "force_offset", "current_gain", "hall_coil_pickup", "lateral_misalignment")),
    "final": ("interval", ("remanence", "current_offset", "force_gain", "hall_offset", "resistance", "force_offset")),
}
"""How errors come and go in each set, and which."""


def truths_of(drawing, set_name):
    """The truths of a set for a drawing, by names that no other set has; also those that it cannot show."""
    k = SETS.index(set_name)
    truths = readings.meter_errors(_BENDS[k]) | {name: make(laws[k]) for name, (make, laws) in _TRUTHS.items()}
    if set_name == "development":
        truths["external_field"] = magnetics.outer_field()
    shape, passing = _IN_SOME_RUNS[set_name]
    for name in passing:
        truths[f"{name} {shape}"] = only_in_some_runs(truths[name], name, shape)
    count = _SATURATING_NUMBERS if read_actuator(drawing).saturates else _LINEAR_NUMBERS
    truths |= number_truths(drawing, k, len(SETS), count)
    return {f"{name} ({set_name})": truth for name, truth in truths.items()}


@dataclass(frozen=True)
class TruthSet:
    """The truths of a set that a device can show, and why it cannot show the others."""

    name: str
    truths: dict
    left_out: dict = field(default_factory=dict)


def prepare_set(drawing, device, directory, set_name, *, workers, progress=None):
    """Solve the changed drawings of a set's truths; the device with their fields, and the truths that it can show."""
    truths, families, left_out = truths_of(drawing, set_name), dict(device.families), {}
    for name, truth in truths.items():
        if reason := truth.lacks(device.actuator):
            left_out[name] = reason
            continue
        try:
            for family, forms in truth.families(device.actuator).items():
                if family not in families:
                    subdirectory = directory / "truths" / re.sub(r"[^\w.-]+", "_", family)
                    drawings = {f"{change:+.6g}": form for change, form in forms.items()}
                    tables = solve_drawings(drawings, subdirectory, workers=workers, progress=progress)
                    families[family] = dict(zip(forms, tables.values(), strict=True))
        except FieldSolverError as error:
            left_out[name] = str(error)
    possible = {name: truth for name, truth in truths.items() if name not in left_out}
    return replace(device, families=families), TruthSet(set_name, possible, left_out)


STEP = 0.04
"""Largest change, over the extent of the part along that axis, or over the material's number."""

_DEAL = 41
"""Seed by which numbers are dealt out; another one would bring numbers that were used before into the final set."""


@dataclass(frozen=True)
class Number:
    """A number of the file: all places that move together, and its largest change in its unit."""

    places: tuple
    step: float
    material: str = ""  # Of a curve whose polarisation it is; the change is relative then
    key: str = ""  # Of a face that moves with the slanted edges beside it

    @property
    def names(self):
        """Key paths."""
        paths = [self.key] * bool(self.key) + [joined("", *place) for place in self.places]
        return tuple(dict.fromkeys(paths)) or (f"materials.{self.material}.B_T",)


def number_truths(drawing, part, parts, count):
    """Up to ``count`` numbers of a drawing, of those that belong to one of ``parts`` disjoint sets."""
    data = parse(read_text(drawing), str(drawing))
    actuator = actuator_from_tables(data, str(drawing), drawing.parent)
    numbers = sorted(_numbers(data, actuator), key=lambda number: number.names)
    order = np.random.default_rng([_DEAL, zlib.crc32(actuator.name.encode())]).permutation(len(numbers))
    truths = {}
    for number in (numbers[k] for k in order[part::parts]):
        forms = _forms(number, data, drawing.parent, not actuator.saturates)
        if forms and len(truths) < count:
            truths[f"drawing:{number.names[0]}"] = _truth(number, actuator, forms)
    return truths


def _forms(number, data, directory, linear):
    """The drawing at two changes of the number, either way if both can be built; at one where iron saturates."""
    shares = (1.0, 0.5, 0.25) if linear else (0.5, 0.25)  # one solution is taken in part: it must not be far
    steps = [round(number.step * share, 6) for share in shares]
    either_way = [(-step, step) for step in steps[:2]] if linear else []
    one_way = [(sign * step / 2, sign * step)[not linear :] for sign in (1, -1) for step in steps]
    for changes in (*either_way, *one_way):
        try:
            return {change: _changed(number, data, change, directory) for change in changes}
        except ActuatorFileError:
            continue
    return {}


def _changed(number, data, change, directory):
    """The drawing with this number changed."""
    tables = deepcopy(dict(data))
    tables["sweep"] = {key: value for key, value in data["sweep"].items() if key in ("current_A", "distance_mm")}
    for place in number.places:
        table = tables
        for key in place[:-1]:
            table = table[key]
        table[place[-1]] = round(float(table[place[-1]]) + change, 9)
    actuator = actuator_from_tables(tables, "changed drawing", directory)

    def polarised(region):
        """Its curve with another polarisation J = B - mu_0 H at each field: another knee."""
        material = region.material
        if not isinstance(material, NonlinearMaterial) or material.name != number.material:
            return material
        h, b = np.array(material.field_A_per_m), np.array(material.flux_density_T)
        b = MU_0 * h + (1.0 + change) * (b - MU_0 * h)
        return replace(material, flux_density_T=tuple(b.tolist()))

    return with_materials(actuator, polarised) if number.material else actuator


def _truth(number, drawn, forms):
    largest, one_way = max(map(abs, forms)), float(np.sign(sum(forms)))
    every = {0.0: drawn, **forms}
    changes, resistances = np.transpose([(p, every[p].coil.resistance_ohm) for p in sorted(every)])

    def change(size):
        return one_way * abs(size) if one_way else size

    def reading(device, size, settings, values):
        more = np.interp(change(size), changes, resistances) - device.actuator.coil.resistance_ohm
        return {"voltage_V": values["voltage_V"] + more * settings.current}

    def fields(device, size, settings):
        return device.change(number.names[0], change(size), settings)

    error = HiddenError(lambda device: largest, FIELD, fields=fields, reading=reading, names=number.names)
    return always(error, "drawing", families=lambda actuator: {number.names[0]: forms})


def _numbers(data, actuator):
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
    materials = [region.material for region in actuator.regions]
    for name in sorted({material.name for material in materials if isinstance(material, NonlinearMaterial)}):
        yield Number((), 2.0 * STEP, material=name)


def _extent(data, location):
    """Of the part that a coordinate belongs to, along its axis, in mm."""
    outline = data
    for key in takewhile(lambda key: not isinstance(key, int), location):
        outline = outline[key]
    if "circle_mm" in location:
        return float(outline[2])
    values = [corner[location[-1]] for corner in outline] if "polygon_mm" in location else outline
    return float(np.ptp(values))
