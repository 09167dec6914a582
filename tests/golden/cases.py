"""The cases by their names: each gives its results by kinds of tolerance."""

import tempfile
from collections.abc import Callable

import numpy as np
import pandas as pd

import femfit as ff
from golden import door
from golden.freeze import frozen

CASES: dict[str, Callable[[], dict]] = {}
LONG: set[str] = set()

MODELS = (
    "rig", "rig-effects", "rig-F1e", "saturable", "plunger", "plunger-effects", "voice-coil", "bearing",
    "bearing-effects", "field-and-voice-coil", "biased", "pot", "magnet-pair", "solenoid",
)  # fmt: skip


def case(name, *, long=False):
    """Register a function without arguments."""

    def register(function):
        CASES[name] = lambda: frozen(function())
        if long:
            LONG.add(name)
        return function

    return register


def of_model(name):
    one = door.model(name)
    result = {"algebra": {"statics": door.statics(one), "order": one.order, "states": list(one.state_names)}}
    if one.circuits:
        result["algebra"]["impedances"] = door.impedances(one)
    if one.motion is not None:
        rates, slopes = door.derivative(one), door.jacobian(one)
        result["algebra"]["rates"] = rates
        result.setdefault("differences" if one.effects else "algebra", {})["slopes"] = slopes
        result["algebra"]["readings"] = door.readings(one)
    if one.motion is not None and one.circuits:
        result["steps"] = {"plant": door.plant_steps(one)}
    return result


def of_filters(name):
    one = door.model(name)
    extended, unscented = (door.asked(door.filter_steps, one, kind) for kind in ("ekf", "ukf"))
    bound = door.asked(door.bound, one)
    if door.slopes_by_differences(one):
        return {"steps": {"ukf": unscented}, "differences": {"ekf": extended, "bound": bound}}
    return {"steps": {"ekf": extended, "ukf": unscented}, "settled": {"bound": bound}}


for _name in MODELS:
    case(f"model-{_name}")(lambda name=_name: of_model(name))
    if _name != "magnet-pair":
        case(f"filter-{_name}", long=_name in {"rig-effects", "pot"})(lambda name=_name: of_filters(name))


FITS = {
    "rig": (None, "all", "F1e", "F2e"),
    "saturable": (None, "all", "F1e"),
    "plunger": (None, "all", "F1e", "F2e"),
    "voice-coil": (None, "all"),
    "bearing": (None,),
    "field-and-voice-coil": (None,),
    "magnet-pair": (None, "all", "F2e"),
    "pot": (None,),
    "plunger-network": ("reluctance-network",),
}


def of_fit(name, laws):
    result = {}
    for law in laws:
        fit = door.fit(name.removesuffix("-network"), law)
        tables = {"statics": door.statics(fit.model)}
        if fit.model.sensor:
            tables["readings"] = door.readings(fit.model)
        if fit.model.eddy:
            tables["impedances"] = door.impedances(fit.model)
        kind = "searched" if law in {"all", "reluctance-network"} else "fitted"
        result.setdefault(kind, {})[law or "coenergy"] = tables | {"facts": door.facts_of_fit(fit)}
    return result


for _name, _laws in FITS.items():
    case(f"fit-{_name}", long=_name in {"rig", "plunger", "pot", "plunger-network"})(
        lambda name=_name, laws=_laws: of_fit(name, laws)
    )


BENCHES = {
    "rig-clean": "rig", "rig-distance": "rig", "rig-two": "rig", "rig-no-run": "rig", "rig-hall-alone": "rig",
    "saturable-two": "saturable", "plunger-clean": "plunger", "plunger-saturated": "plunger",
    "solenoid-hysteresis": "solenoid", "voice-coil-two": "voice-coil", "bearing-clean": "bearing",
    "bearing-two": "bearing", "pot-impedance": "pot", "rig-lag-impedance": "rig",
}  # fmt: skip

_UNDETERMINED = {"plunger-saturated", "solenoid-hysteresis"}
_LONG_BENCHES = {"rig-no-run", "rig-two", "rig-distance", "rig-hall-alone", "bearing-two", "pot-impedance"}

for _name, _of in BENCHES.items():
    case(f"bench-{_name}", long=_name in _LONG_BENCHES)(
        lambda name=_name, of=_of: door.bench(of, door.bench_file(name), alone=name in _UNDETERMINED)
    )


RECORDS = {
    "rig-held": "rig", "rig-heavy": "rig", "bearing-held": "bearing", "solenoid": "solenoid",
    "solenoid_warm": "solenoid", "voice-coil": "voice-coil",
}  # fmt: skip

for _name, _of in RECORDS.items():
    _filters = ("ukf",) if "solenoid" in _name else ("ukf", "ekf")
    case(f"observe-{_name}", long=_name in {"rig-heavy", "solenoid_warm", "bearing-held"})(
        lambda name=_name, of=_of, filters=_filters: {"searched": door.observed(of, name, filter=filters)}
    )
    if "held" not in _name and "heavy" not in _name:  # these hold neither current nor distance
        case(f"record-{_name}", long=True)(
            lambda name=_name, of=_of: door.bench(of, door.record_file(name), alone=True)
        )


@case("import-tables")
def tables():
    """Tables of other programs, and measurements."""
    names = ("si.csv", "millimetres.csv", "commas.csv", "blanks.txt", "tabs.txt", "units-below.csv", "commented.txt",
             "inductance.csv", "sign.csv", "pipes.csv", "matrix.csv", "by-current", "thousands.csv")  # fmt: skip
    found = {name: door.asked(door.imported, name) for name in names}
    measured = ("scale.csv", "sensors.csv", "named.csv", "bridge.csv", "log.csv")
    found |= {name: door.asked(door.measured, door.INPUTS / "tables" / name) for name in measured}
    found |= {name: door.measured(door.bench_file(name)) for name in ("rig-two", "bearing-two", "pot-impedance")}
    return {"read": found | {"record": door.measured(door.record_file("solenoid"))}}


@case("import-fem")
def fem():
    """FEMM models as drawings."""
    names = ("suspension", "below", "inches", "voice-coil", "two-circuits")
    return {"algebra": {name: door.asked(door.drawn, name) for name in names}}


for _name in ("rig", "voice-coil", "plunger-effects"):

    @case(f"export-{_name}")
    def export(name=_name):
        """Numbers of an exported model."""
        with tempfile.TemporaryDirectory() as directory:
            return {"differences" if "effects" in name else "steps": door.exported(name, f"{directory}/out")}


@case("heat")
def heat():
    """Temperatures of a drawing with all that it lasts."""
    return {"settled": ff.find_temperatures(door.drawing("rig"), current_A=0.8).to_dict()}


@case("audit")
def audit():
    """Conclusions about models, with and without their tables."""
    sweeps = door.INPUTS / "sweeps"
    return {"fitted": {name: door.audited(name, sweeps / name) for name in ("rig", "plunger", "bearing", "voice-coil")}}


@case("tolerance")
def tolerance():
    """What the drawing's tolerances make of a series."""
    force = door.tolerances("rig", distance_m=0.02, currents_A=(0.4,))
    return {
        "algebra": {
            "force": force,
            "hall": door.tolerances("rig", distance_m=0.03, currents_A=(0.0,), quantity="hall_T"),
        }
    }


@case("integrate")
def integrate():
    """A coil's voltage by each method."""
    time = 2e-3 * np.arange(1500)
    wiggle = 1e-6 * np.cos(1e3 * np.arange(1500.0) ** 2)
    rows = pd.DataFrame(
        {
            "time_s": time,
            "coil_voltage_V": 1e-3 * np.sin(time) + 2e-5 + wiggle,
            "hall_T": 0.1 * (1.0 - np.cos(time)) + 10.0 * wiggle,
            "current_A": 1.0 - np.cos(time),
        }
    )
    options = {
        "trapezoid": {},
        "ffa1": {"zero_reading_s": 0.5},
        "ffa2": {},
        "cs2": {"current_to_field_A_per_T": 10.0},
        "cs1-offset": {},
    }
    return {
        "settled": {
            name: ff.integrate_coil(rows, method=name, coil_area_m2=0.01, **more).to_dict()
            for name, more in options.items()
        }
    }


@case("simulate")
def simulate():
    """Open loops: a solenoid with stops and diode, a plunger, a coil on springs with two circuits."""
    return {
        "searched": {
            "solenoid": door.simulated("solenoid", voltage_V=12.0, duration_s=0.05),
            "plunger": door.asked(door.simulated, "plunger", voltage_V=6.0, duration_s=0.02, start_m=0.006),
            "pot": door.asked(door.simulated, "pot", voltage_V=6.0, duration_s=0.005, start_m=0.003),
        }
    }


for _name, _options in {
    "rig": {"controller": "pid"},
    "bearing": {"controller": "state-feedback", "estimator": "ukf"},
    "voice-coil": {"controller": "backstepping", "estimator": "ekf"},
    "rig-F1e": {"controller": "pid", "estimator": "ekf4", "plant": "rig-effects"},
}.items():
    case(f"loop-{_name}", long=_name in {"rig", "bearing"})(
        lambda name=_name, options=_options: door.closed(name, runs=2, seconds=0.1, rng=1, **options)
    )


@case("sense")
def sense():
    """How well a current tells the distance."""
    return {"searched": ff.sense(door.model("solenoid"), voltage_V=12.0, runs=2, rng=1).to_dict()}


@case("suggest")
def suggest():
    """The next measurement."""
    return {"searched": ff.suggest(door.model("rig"), door.bench_file("rig-no-run")).to_dict()}


@case("calibrate", long=True)
def calibrate():
    """A number of the drawing found from a bench table, with the field solved anew."""
    number = "moving.regions.magnet.r_mm[1]"
    with tempfile.TemporaryDirectory() as directory:
        return {"searched": door.calibrated("rig", "rig-two", directory, number)}
