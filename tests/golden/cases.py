"""The cases by their names, as data: what of door.py gives their results, by kinds of tolerance."""

from functools import partial

import femfit as ff
from golden import door
from golden.door import model, stored

MODELS = (
    "rig", "rig-effects", "rig-F1e", "saturable", "plunger", "plunger-effects", "voice-coil", "bearing",
    "bearing-effects", "field-and-voice-coil", "biased", "pot", "magnet-pair", "solenoid",
)  # fmt: skip
FITS = {
    "rig": (None, "all", "F1e", "F2e"),
    "saturable": (None, "all", "F1e"),
    "plunger": (None, "all", "F1e", "F2e"),
    "voice-coil": (None, "all"),
    "bearing": (None,),
    "field-and-voice-coil": (None,),
    "magnet-pair": (None, "all", "F2e"),
    "pot": (None,),
}
BENCHES = {
    "rig-clean": "rig", "rig-distance": "rig", "rig-two": "rig", "rig-no-run": "rig", "rig-hall-alone": "rig",
    "saturable-two": "saturable", "plunger-clean": "plunger", "plunger-saturated": "plunger",
    "solenoid-hysteresis": "solenoid", "voice-coil-two": "voice-coil", "bearing-clean": "bearing",
    "bearing-two": "bearing", "pot-impedance": "pot", "rig-lag-impedance": "rig",
}  # fmt: skip
UNDETERMINED = {"plunger-saturated", "solenoid-hysteresis"}
RECORDS = {
    "rig-held": "rig", "rig-heavy": "rig", "bearing-held": "bearing", "solenoid": "solenoid",
    "solenoid_warm": "solenoid", "voice-coil": "voice-coil",
}  # fmt: skip
MOVING = ("solenoid", "solenoid_warm", "voice-coil")
"""Records that hold neither current nor distance: what they say of a model."""

FOREIGN = ("si.csv", "millimetres.csv", "commas.csv", "blanks.txt", "tabs.txt", "units-below.csv", "commented.txt",
           "inductance.csv", "sign.csv", "pipes.csv", "matrix.csv", "by-current", "thousands.csv")  # fmt: skip
MEASURED = ("scale.csv", "sensors.csv", "named.csv", "bridge.csv", "log.csv")
FEM = ("suspension", "below", "inches", "voice-coil", "two-circuits")
METHODS = {
    "trapezoid": {},
    "ffa1": {"zero_reading_s": 0.5},
    "ffa2": {},
    "cs2": {"current_to_field_A_per_T": 10.0},
    "cs1-offset": {},
}
OPEN_LOOPS = {
    "solenoid": {"voltage_V": 12.0, "duration_s": 0.05},
    "plunger": {"voltage_V": 6.0, "duration_s": 0.02, "start_m": 0.006},
    "pot": {"voltage_V": 6.0, "duration_s": 0.005, "start_m": 0.003},
}
LOOPS = {
    "rig": {"controller": "pid"},
    "bearing": {"controller": "state-feedback", "estimator": "ukf"},
    "voice-coil": {"controller": "backstepping", "estimator": "ekf"},
    "rig-F1e": {"controller": "pid", "estimator": "ekf4", "plant": "rig-effects"},
}
TOLERANCES = {
    "force": {"distance_m": 0.02, "currents_A": (0.4,)},
    "hall": {"distance_m": 0.03, "currents_A": (0.0,), "quantity": "hall_T"},
}

CASES = {
    **{f"model-{name}": partial(door.of_model, name) for name in MODELS},
    **{f"filter-{name}": partial(door.of_filters, name) for name in MODELS if name != "magnet-pair"},
    **{f"fit-{name}": partial(door.of_fit, name, laws) for name, laws in FITS.items()},
    "fit-plunger-network": partial(door.of_fit, "plunger", ("reluctance-network",)),
    **{
        f"bench-{name}": partial(door.bench, of, stored("benches", name), name in UNDETERMINED)
        for name, of in BENCHES.items()
    },
    **{
        f"observe-{name}": partial(door.observed, of, name, ("ukf",) if "solenoid" in name else ("ukf", "ekf"))
        for name, of in RECORDS.items()
    },
    **{f"record-{name}": partial(door.bench, RECORDS[name], stored("records", name), True) for name in MOVING},
    "import-tables": partial(
        door.tables, FOREIGN, MEASURED, ("rig-two", "bearing-two", "pot-impedance"), {"record": "solenoid"}
    ),
    "import-fem": lambda: {"algebra": {name: door.asked(door.drawn, name) for name in FEM}},
    **{f"export-{name}": partial(door.exported, name) for name in ("rig", "voice-coil", "plunger-effects")},
    "heat": lambda: {"settled": ff.find_temperatures(stored("drawings", "rig", "toml"), current_A=0.8).to_dict()},
    "audit": lambda: {"fitted": {name: door.audited(name) for name in ("rig", "plunger", "bearing", "voice-coil")}},
    "tolerance": lambda: {"algebra": {name: door.tolerances("rig", **at) for name, at in TOLERANCES.items()}},
    "integrate": partial(door.integrated, METHODS),
    "simulate": lambda: {"searched": {of: door.asked(door.simulated, of, **how) for of, how in OPEN_LOOPS.items()}},
    **{f"loop-{name}": partial(door.closed, name, **options) for name, options in LOOPS.items()},
    "sense": lambda: {"searched": ff.sense(model("solenoid"), voltage_V=12.0, runs=2, rng=1).to_dict()},
    "suggest": lambda: {"searched": ff.suggest(model("rig"), stored("benches", "rig-no-run")).to_dict()},
    "calibrate": partial(door.calibrated, "rig", "rig-two", "moving.regions.magnet.r_mm[1]"),
}

LONG = {
    "filter-rig-effects", "filter-pot", "filter-field-and-voice-coil", "fit-rig", "fit-plunger", "fit-pot",
    "fit-plunger-network", "bench-rig-no-run", "bench-rig-two", "bench-rig-distance", "bench-rig-hall-alone",
    "bench-bearing-two", "bench-pot-impedance", "observe-rig-heavy", "observe-solenoid", "observe-solenoid_warm",
    "observe-bearing-held", "observe-voice-coil", "record-solenoid", "record-solenoid_warm", "record-voice-coil",
    "loop-rig", "loop-bearing", "loop-rig-F1e", "suggest", "calibrate",
}  # fmt: skip
"""Nightly: a further device of a kind, which others of that kind show by default, or of which a command does."""
