"""Changed drawings of a solenoid and a voice coil: what a workshop, a supplier or a press fit makes of them.

Every change is an edit of the text of the drawing, so that it reads as somebody would have drawn it.
"""

from pathlib import Path

from femfit.device.load import read_actuator

GEOMETRY = Path(__file__).parents[3] / "geometry"

DRAWN = "drawn"

_SOLENOID_FRAME = """polygon_mm = [
    [1.5, -10], [16, -10], [16, 30], [5.3, 30], [5.3, 26], [14, 26], [14, -6], [5, -6], [5, 0], [1.5, 0],
]
"""
_GAPPED_FRAME = """polygon_mm = [[1.5, -10], [16, -10], [16, 25.9], [14, 25.9], [14, -6], [5, -6], [5, 0], [1.5, 0]]

[fixed.regions.cover]
material = "steel_1010"
r_mm = [5.3, 16]
z_mm = [26, 30]
"""
_KEPT_FLUX = """
[coils.kept]
r_mm = [13.6, 13.9]
z_mm = [-5, 25]
turns = 1
resistance_ohm = 1

[moving.regions.plunger]"""
_TWO_MAGNETS = """r_mm = [0, 12]
z_mm = [-16, -8]

[fixed.regions.weak]
material = "weak"
magnetization = "+z"
r_mm = [0, 12]
z_mm = [-8, -4]

[materials.weak]
relative_permeability = 1.05
remanence_T = 1.05
"""

FORMS = {
    "solenoid": {
        DRAWN: {},
        "other_steel": {'material = "steel_1010"': 'material = "steel_1018"'},
        "kept_flux": {
            "\n[moving.regions.plunger]": _KEPT_FLUX,
            'kind = "current"\n': 'kind = "current"\ncircuit = "winding"\n',
        },
        "back_gap": {_SOLENOID_FRAME: _GAPPED_FRAME},
        "shorted_turns": {"turns = 900": "turns = 873"},
        "short_pole": {"[5, 0], [1.5, 0]": "[5, -0.08], [1.5, -0.08]"},
        "worn_bore": {"r_mm = [0, 5]\n": "r_mm = [0, 4.9]\n"},
    },
    "voice-coil": {
        DRAWN: {},
        "weak_layer": {"r_mm = [0, 12]\nz_mm = [-16, -4]\n": _TWO_MAGNETS},
        "weak_magnet": {'material = "n42"': 'material = "n40"'},
        "wide_gap": {"[16, 0], [16, -4]": "[16.2, 0], [16.2, -4]"},
        "shorted_turns": {"turns = 100": "turns = 97"},
    },
}

SETTINGS = {
    "solenoid": ((0.25, 0.5, 0.75, 1.0, 1.2, 1.35), (0.2, 0.3, 0.5, 0.8, 1.2, 1.6, 2.0, 2.5, 3.0, 3.6, 4.0)),
    "voice-coil": ((-2.8, -1.0, 1.0, 2.8), (-8.6, -7.8, -6.9, -6.0, -5.1, -4.2, -3.4)),
}
"""Currents in A and distances in mm at which a bench is read, and every form is solved."""

_FREE: dict[str, dict[str, str]] = {"solenoid": {}, "voice-coil": {"travel_mm = [-9, -3]\n": ""}}
"""Stops have no place in a sweep that does not go to them."""

KEPT_A = 22.0
"""Ampere-turns that the shell keeps, as a current sheet on its inside."""


_FINER = {"[0.2, 0.3, 0.4,": "[0.2, 0.25, 0.3, 0.4,"}
"""One distance more at the solenoid's stop, where its force bends most between two currents."""


def write_model_drawing(device: str, directory: Path) -> Path:
    """Write the drawing that the model is fitted to: the project's, swept finely enough for a bench at any current."""
    directory.mkdir(parents=True, exist_ok=True)
    text = (GEOMETRY / f"{device}.toml").read_text(encoding="utf-8")
    for before, after in _FINER.items() if device == "solenoid" else ():
        if before not in text:
            raise ValueError(f"The drawing of a {device} must hold {before!r}.")
        text = text.replace(before, after)
    path = directory / f"{device}.toml"
    path.write_text(text, encoding="utf-8")
    return path


def drawing_text(device: str, form: str) -> str:
    """A drawing's text with the edits of a form, and the settings of a bench as its sweep."""
    text = (GEOMETRY / f"{device}.toml").read_text(encoding="utf-8")
    for before, after in (FORMS[device][form] | _FREE[device]).items():
        if before not in text:
            raise ValueError(f"The drawing of a {device} must hold {before!r} for its form {form}.")
        text = text.replace(before, after)
    currents, distances = SETTINGS[device]
    several = f"{{ winding = {list(currents)}, kept = [{KEPT_A}] }}" if "[coils.kept]" in text else list(currents)
    head, _, tail = text.partition("[sweep]")
    solver = tail[tail.index("[solver]") :]
    return f"{head}[sweep]\ncurrent_A = {several}\ndistance_mm = {list(distances)}\n\n{solver}"


def write_drawing(device: str, form: str, directory: Path) -> Path:
    """Write a changed drawing, and read it once."""
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / f"{device}-{form}.toml"
    path.write_text(drawing_text(device, form), encoding="utf-8")
    read_actuator(path)
    return path
