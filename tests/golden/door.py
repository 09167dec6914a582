"""The only way from the golden cases into femfit, one function a kind: what moves in the library is followed here.

Each gives its results by kinds of tolerance, as in freeze.py.
"""

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import femfit as ff
from femfit.audit.audit_model import audit_model
from femfit.model.drive import command_limits
from femfit.model.dynamics import state_derivative
from femfit.model.sensors import sampled_readings, sensors_of
from femfit.simulation.plant import Plant
from femfit.tables.femm.read import import_fem_file
from support.model_kinds import state_jacobian

INPUTS = Path(__file__).parent / "inputs"
POINTS = 50
FREQUENCIES = (0.0, 1.0, 30.0, 1000.0, 30000.0)


def stored(kind, name, suffix="csv"):
    return INPUTS / kind / f"{name}.{suffix}"


def model(name):
    return ff.read_model(stored("models", name, "json"))


def asked(function, *given, **options):
    """What a function gives, or the kind of its refusal."""
    try:
        return function(*given, **options)
    except ff.FemfitError as refusal:
        return type(refusal).__name__


def spread(count, columns):
    """Numbers in 0..1 that fill a box evenly (Kronecker's sequence of square roots of primes)."""
    roots = np.sqrt([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71][:columns])
    return np.outer(np.arange(1, count + 1), roots) % 1.0


def points(one, count=POINTS):
    """Distances (n,) and currents with an axis (n, circuits); of no circuit (n, 1) where the domain has currents."""
    box = one.validity
    limits = np.array([(box.distance_min_m, box.distance_max_m), *box.current_limits_A])
    at = limits[:, 0] + np.ptp(limits, axis=1) * spread(count, len(limits))
    return at[:, 0], at[:, 1:]


def as_taken(values):
    """Currents or voltages of several circuits, or of one without its axis, as the model's methods take them."""
    return values[..., 0] if values.shape[-1] == 1 else values if values.size else np.zeros(len(values))


def states(one, count=POINTS):
    """States with speeds up to 0.1 m/s and small currents and numbers in what eddies and effects add, and commands."""
    d, i = points(one, count)
    n = len(one.circuits)
    free = 2.0 * spread(count, 1 + one.order - n) - 1.0  # column 0: unused, so that the others stay apart from d
    free[:, 1:2] *= 0.1
    at = np.column_stack([d, free[:, 1], i[:, :n], 0.02 * free[:, 2 : one.order - n]])
    limits = np.array([command_limits(circuit) for circuit in one.circuits]).reshape(-1, 2)
    return at, limits[:, 0] + np.ptp(limits, axis=1) * spread(count, 3 + n)[:, 3:]


def statics(one):
    """Force, flux linkage, inductance and motional constant over the domain, (n, ...) with an axis of circuits."""
    d, currents = points(one)
    i = as_taken(currents)
    motional = one.magnetics.motional_constant(d, one.validity.with_axis(i))
    motional = motional if currents.shape[1] > 1 else motional.sum(axis=-1)
    magnetic = {"force_N": one.force(d, i), "flux_linkage_Wb": one.flux_linkage(d, i)}
    magnetic |= {"inductance_H": one.inductance(d, i), "motional_constant_N_A": motional}
    return {name: np.reshape(values, (len(d), -1)) for name, values in magnetic.items()}


def readings(one):
    at, _ = states(one)
    return {name: asked(sampled_readings, one, sensor, at) for name, sensor in sensors_of(one).items()}


def impedances(one):
    d, i = points(one, 5)
    values = {f"{f:g}_Hz": one.impedance(d, as_taken(i), f) for f in FREQUENCIES}
    return {"impedance": {name: np.reshape(z, (len(d), -1)) for name, z in values.items()}}


def by_state(one, values):
    return dict(zip(one.state_names, np.asarray(values).T, strict=True))


def of_model(name):
    """Statics, impedances, rates and slopes of the motion, readings, and one and ten samples of the plant."""
    one = model(name)
    algebra = {"statics": statics(one), "order": one.order, "states": list(one.state_names)}
    result = {"algebra": algebra}
    if one.circuits:
        algebra["impedances"] = impedances(one)
    if one.motion is None:
        return result
    at, volts = states(one)
    few, few_volts = states(one, 5)
    inputs, few_inputs = (v[:, 0] if len(one.circuits) == 1 else v for v in (volts, few_volts))
    slopes = state_jacobian(one, few, few_inputs)
    algebra["rates"] = by_state(one, state_derivative(one, at, inputs))
    algebra["readings"] = readings(one)
    differences = result.setdefault("differences", {}) if one.effects else algebra
    differences["slopes"] = {state: by_state(one, slopes[:, k]) for k, state in enumerate(one.state_names)}
    if one.circuits:
        few[:, 1] *= 0.1
        plant, after = Plant(one), {}
        now = plant.start(few[:, : 2 + len(one.circuits)])
        for k in range(1, 11):
            now = plant.step(now, few_volts)
            after[f"after_{k}"] = by_state(one, now)
        result["steps"] = {"plant": {key: after[key] for key in ("after_1", "after_10")}}
    return result


def filter_steps(one, kind, count=5):
    """Means, deviations, correlations and innovations of a filter along steps with given readings."""
    tracker = ff.kalman_filter(one, kind)
    box, process, n = one.validity, tracker.process, len(one.circuits)
    distance = box.distance_min_m + 0.4 * (box.distance_max_m - box.distance_min_m)
    first = np.array([distance, 0.0, *np.mean(box.current_limits_A, axis=1)[:n]])
    body = np.zeros((1, one.order))
    body[0, : len(first)] = first
    known = sensors_of(one)
    rest = [float(sampled_readings(one, known[output.name], body)[0]) for output in process.outputs]
    noise = np.array([output.variance**0.5 for output in process.outputs])
    state, steps = tracker.start(first), {}
    for k, volts in enumerate(states(one, count)[1]):
        wiggle = noise * (2.0 * spread(k + 1, len(rest))[k] - 1.0)
        state = tracker.step(state, volts if process.inputs != 1 else volts[0], np.array(rest) + wiggle)
        deviation = np.sqrt(np.diag(state.covariance[0]))
        steps[f"step_{k + 1}"] = {
            "mean": dict(zip(process.names, state.mean[0], strict=True)),
            "deviation": dict(zip(process.names, deviation, strict=True)),
            "correlation": state.covariance[0] / np.outer(deviation, deviation),
            "innovation": np.ravel(state.innovation),
            "innovation_variance": np.ravel(state.innovation_variance),
            "outcome": state.outcome,
        }
    return steps


def bound(one):
    least = ff.error_bound(one)
    deviation = dict(zip(least.names, least.deviations.T, strict=True))
    return {"sensors": least.sensors, "deviation": deviation, "observed": least.observed}


def of_filters(name):
    """Both filters and their bound; a Jacobian by differences where there are effects, diodes or amplifiers."""
    one = model(name)
    extended, unscented = (asked(filter_steps, one, kind) for kind in ("ekf", "ukf"))
    least = asked(bound, one)
    plain = all(circuit.drive.kind == "voltage" and circuit.drive.diode_V is None for circuit in one.circuits)
    if one.effects or not plain:
        return {"steps": {"ukf": unscented}, "differences": {"ekf": extended, "bound": least}}
    return {"steps": {"ekf": extended, "ukf": unscented}, "settled": {"bound": least}}


def of_fit(name, laws):
    """Fits of a stored sweep; laws without what each number of the drawing changes, which takes long."""
    table, result = ff.read_sweep(INPUTS / "sweeps" / name), {}
    for law in laws:
        fitted = ff.fit_model(replace(table, signatures=None) if law else table, law=law)
        numbers = {"statics": statics(fitted.model), "facts": facts_of_fit(fitted)}
        if fitted.model.sensor:
            numbers["readings"] = readings(fitted.model)
        if fitted.model.eddy:
            numbers["impedances"] = impedances(fitted.model)
        kind = "searched" if law in {"all", "reluctance-network"} else "fitted"
        result.setdefault(kind, {})[law or "coenergy"] = numbers
    return result


def facts_of_fit(fitted):
    """Numbers of a fit; a coefficient that is rounding beside the others, as on a bound, is zero."""
    facts = fitted.to_dict()
    terms = (facts["law"] or {}).get("terms", ())
    largest = max((abs(one["value"]) for one in terms), default=0.0)
    for term in terms:
        for key in ("value", "interval95"):
            values = np.array(term[key], dtype=float)
            term[key] = np.where(np.abs(values) < 1e-14 * largest, 0.0, values)
    if facts["hall"]:  # of a device without a magnet
        field = np.array(facts["hall"]["magnet_field_T"])
        facts["hall"]["magnet_field_T"] = np.where(np.abs(field) < 1e-12, 0.0, field)
    return facts


def bench(of, data, alone=False):
    """What a measurement says of a model; what a diagnosis names is added.

    Left out: what ties, which rounding decides; and of families that these data do not determine (``alone``) all sizes.
    """
    one = model(of)
    compared, found = ff.compare(one, data), ff.diagnose(one, data)
    added = asked(ff.add_effects, one, data, found) if found.missing else None
    comparison, diagnosis = compared.to_dict(), found.to_dict()
    names = [effect["name"] for effect in diagnosis["missing"]]
    if alone:
        kept = ("verdict", "noise_floor", "detectable", "where", "rms", "findings")
        diagnosis = {key: diagnosis[key] for key in kept}
        return {"fitted": {"compare": comparison, "diagnose": diagnosis, "names": names, "accepted": added.accepted}}
    for effect in diagnosis["missing"]:
        del effect["tied_words"], effect["tie"]
    diagnosis["look_alikes"] = sorted(diagnosis["look_alikes"])
    diagnosis["ranking"] = {effect.pop("name"): effect for effect in map(dict, diagnosis["ranking"])}
    result = {"names": names, "diagnose": diagnosis}
    if added:
        result["add"] = added.to_dict() if isinstance(added, ff.AddResult) else added
    return {"fitted": {"compare": comparison}, "searched": result}


def observed(of, name, filters):
    seen = ff.observe(model(of), stored("records", name), filter=filters)
    table = {key: values.to_numpy()[::50] for key, values in seen.table.items()}
    return {"searched": seen.to_dict() | {"series": table, "findings": [one.code for one in seen.findings]}}


def columns_of(rows):
    """What columns hold: numbers of each, their sum, largest and a weighted sum that sees their order."""
    found = {}
    for name in rows.select_dtypes("number"):
        values = rows[name].to_numpy(dtype=float)
        values = values[np.isfinite(values)]
        weights = np.cos(np.arange(len(values)))
        found[name] = {"count": len(values), "sums": [values.sum(), values @ weights, np.abs(values).max(initial=0.0)]}
    return found


def _codes(findings):
    return sorted(f"{one.code}:{one.severity}:{one.column}" for one in findings)


def imported(name):
    table = ff.import_table(INPUTS / "tables" / name)
    mapping = [(one.name, one.header, one.unit, one.factor) for one in table.mapping]
    return {"columns": columns_of(table.rows), "mapping": mapping, "findings": _codes(table.findings)}


def measured(path):
    data = ff.read_measurement(path)
    facts = {"kind": type(data).__name__, "given": data.given, "findings": _codes(data.findings)}
    return facts | {"columns": columns_of(data.rows)}


def tables(foreign, measurements, benches, records):
    found = {name: asked(imported, name) for name in foreign}
    found |= {name: asked(measured, INPUTS / "tables" / name) for name in measurements}
    found |= {name: measured(stored("benches", name)) for name in benches}
    return {"read": found | {name: measured(stored("records", of)) for name, of in records.items()}}


def drawn(name):
    found = import_fem_file(stored("fem", name, "fem"))
    return {"drawing": tomllib.loads(found.toml), "facts": found.to_dict() | {"findings": _codes(found.findings)}}


EXPORTED = """
import json, sys, estimator as e
first, n = json.loads(sys.argv[1]), len(e.CIRCUITS)
plant = e.Plant(first)
for _ in range(5):
    plant.step([1.0] * n)
found = {"file": e.__file__, "state": plant.state}
for kind in ("ekf", "ukf"):
    tracker = e.Filter(kind)
    tracker.start(first)
    for _ in range(5):
        tracker.step([1.0] * n, [0.5] * len(e.SENSORS))
    found[kind] = [tracker.mean, tracker.deviations()]
print(json.dumps(found))
"""


def exported(name):
    """Numbers of an exported model, in a process that does not see this package."""
    one = model(name)
    box = one.validity
    currents = box.current_limits_A.mean(axis=1)[: len(one.circuits)].tolist()
    first = json.dumps([0.5 * (box.distance_min_m + box.distance_max_m), 0.0, *currents])
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    run = [sys.executable, "-c", EXPORTED, first]
    with tempfile.TemporaryDirectory() as folder:
        done = ff.export(one, f"{folder}/out")
        place = {"cwd": f"{folder}/out", "env": environment}
        found = json.loads(subprocess.run(run, **place, check=True, capture_output=True).stdout)
        assert Path(found.pop("file")).is_relative_to(Path(folder).resolve())
    return {"differences" if one.effects else "steps": {"target": done.target, "numbers": found}}


def audited(name):
    """Conclusions of an audit by their codes; what is recomputed as rounding is zero."""
    found = {}
    for one in audit_model(model(name), INPUTS / "sweeps" / name).findings:
        numbers = [0.0 if value and abs(value) < 1e-7 else value for value in (one.stated, one.recomputed)]
        found.setdefault(one.code, []).append([one.severity, *numbers])
    return found


def tolerances(name, **at):
    found = ff.analyse_tolerances(INPUTS / "sweeps" / name, **at)
    shares = {one.number.name: [one.gradient, one.share] for one in found.shares}
    return {"value": found.value, "scatter": found.scatter, "shares": shares}


def integrated(methods):
    time = 2e-3 * np.arange(1500)
    wiggle = 1e-6 * np.cos(1e3 * np.arange(1500.0) ** 2)
    columns = {
        "time_s": time,
        "coil_voltage_V": 1e-3 * np.sin(time) + 2e-5 + wiggle,
        "hall_T": 0.1 * (1.0 - np.cos(time)) + 10.0 * wiggle,
        "current_A": 1.0 - np.cos(time),
    }
    rows, area = pd.DataFrame(columns), {"coil_area_m2": 0.01}
    of = {name: ff.integrate_coil(rows, method=name, **area, **more).to_dict() for name, more in methods.items()}
    return {"settled": of}


def simulated(name, **options):
    """An open loop: what happened, and a part of its table."""
    found = ff.simulate(model(name), **options)
    facts = found.to_dict()
    del facts["energy"]["remainder_J"]  # of rounding
    return facts | {"table": {key: values[::100] for key, values in found.table.items()}}


def closed(name, plant=None, **options):
    found = ff.close_loop(model(name), plant=plant and model(plant), runs=2, seconds=0.1, rng=1, **options)
    data = found.to_dict() | {"ends": found.result.series.distance_m[-1]}
    return {"settled": {"design": data.pop("design")}, "bits": data}


def calibrated(name, data, numbers):
    """A drawing's number found from a bench table; its field is solved."""
    with tempfile.TemporaryDirectory() as folder:
        drawing, table = stored("drawings", name, "toml"), stored("benches", data)
        return {"searched": ff.calibrate(drawing, table, folder, numbers=numbers, workers=1).to_dict()}
