"""The only way from the golden cases into femfit: what moves in the library is followed here."""

import json
import os
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

import femfit as ff
from femfit.audit.audit_model import audit_model
from femfit.model.drive import command_limits
from femfit.model.dynamics import state_derivative, state_jacobian
from femfit.model.sensors import sampled_readings, sensors_of
from femfit.simulation.plant import Plant
from femfit.tables.femm.read import import_fem_file

INPUTS = Path(__file__).parent / "inputs"
POINTS = 50


def model(name):
    """A stored model."""
    return ff.read_model(INPUTS / "models" / f"{name}.json")


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


def as_taken(one, currents):
    """Currents in the shape that the model's methods take."""
    count = len(one.validity.current_limits_A)
    return currents if count > 1 else currents[..., 0] if count else np.zeros(currents.shape[:-1])


def states(one, count=POINTS):
    """States with speeds up to 0.1 m/s and small currents and numbers in what eddies and effects add."""
    d, i = points(one, count)
    n = len(one.circuits)
    free = 2.0 * spread(count, 1 + one.order - n) - 1.0  # column 0: unused, so that the others stay apart from d
    free[:, 1:2] *= 0.1
    result = np.column_stack([d, free[:, 1], i[:, :n], 0.02 * free[:, 2 : one.order - n]])
    return result, voltages(one, count)


def voltages(one, count=POINTS):
    """Of each circuit, (n, circuits): commands within what its supply gives."""
    limits = np.array([command_limits(circuit) for circuit in one.circuits]).reshape(-1, 2)
    return limits[:, 0] + np.ptp(limits, axis=1) * spread(count, 3 + len(limits))[:, 3:]


def statics(one):
    """Force, flux linkage, inductance and motional constant over the domain, (n, ...) with an axis of circuits."""
    d, i = points(one)
    i = as_taken(one, i)
    magnetic = {
        "force_N": one.force(d, i),
        "flux_linkage_Wb": one.flux_linkage(d, i),
        "inductance_H": one.inductance(d, i),
    }
    motional = one.magnetics.motional_constant(d, one.validity.with_axis(i))
    magnetic["motional_constant_N_A"] = motional if len(one.validity.current_limits_A) > 1 else motional.sum(axis=-1)
    return {name: np.reshape(values, (len(d), -1)) for name, values in magnetic.items()}


def readings(one):
    """All sensors in the states, each as of one moment, and as samples one after the other with their delays."""
    at, _ = states(one)
    return {name: asked(sampled_readings, one, sensor, at) for name, sensor in sensors_of(one).items()}


FREQUENCIES = (0.0, 1.0, 30.0, 1000.0, 30000.0)


def impedances(one):
    """Impedances at some points and frequencies."""
    d, i = points(one, 5)
    i = as_taken(one, i)
    values = {f: one.impedance(d, i, f) for f in FREQUENCIES}
    return {"impedance": {f"{f:g}_Hz": np.reshape(z, (len(d), -1)) for f, z in values.items()}}


def _inputs(one, volts):
    return volts if len(one.circuits) != 1 else volts[:, 0]


def by_state(one, values):
    """Columns by the states' names."""
    return dict(zip(one.state_names, np.asarray(values).T, strict=True))


def derivative(one):
    """Time derivatives of the states."""
    at, volts = states(one)
    return by_state(one, state_derivative(one, at, _inputs(one, volts)))


def jacobian(one):
    """Rows of the linearised motion at five states."""
    at, volts = states(one, 5)
    slopes = state_jacobian(one, at, _inputs(one, volts))
    return {name: by_state(one, slopes[:, k]) for k, name in enumerate(one.state_names)}


def plant_steps(one, count=10):
    """States after one and after ten samples of the plant, from five places, the command held."""
    at, volts = states(one, 5)
    at[:, 1] *= 0.1
    plant = Plant(one)
    now, found = plant.start(at[:, : 2 + len(one.circuits)]), {}
    for k in range(1, count + 1):
        now = plant.step(now, volts)
        if k in (1, count):
            found[f"after_{k}"] = by_state(one, now)
    return found


def filter_steps(one, kind, sensors=None, count=5):
    """Means, deviations, correlations and innovations of a filter along steps with given readings."""
    tracker = ff.kalman_filter(one, kind, sensors=sensors)
    box, process = one.validity, tracker.process
    first = np.array(
        [
            box.distance_min_m + 0.4 * (box.distance_max_m - box.distance_min_m),
            0.0,
            *np.mean(box.current_limits_A, axis=1)[: len(one.circuits)],
        ]
    )
    known = sensors_of(one)
    body = np.zeros((1, one.order))
    body[0, : len(first)] = first
    rest = [float(sampled_readings(one, known[output.name], body)[0]) for output in process.outputs]
    volts, state, found = voltages(one, count), tracker.start(first), {}
    for k in range(count):
        wiggle = np.array([output.variance**0.5 for output in process.outputs]) * (
            2.0 * spread(k + 1, len(rest))[k] - 1.0
        )
        given = volts[k] if process.inputs != 1 else volts[k, 0]
        state = tracker.step(state, given, np.array(rest) + wiggle)
        deviation = np.sqrt(np.diag(state.covariance[0]))
        found[f"step_{k + 1}"] = {
            "mean": dict(zip(process.names, state.mean[0], strict=True)),
            "deviation": dict(zip(process.names, deviation, strict=True)),
            "correlation": state.covariance[0] / np.outer(deviation, deviation),
            "innovation": np.ravel(state.innovation),
            "innovation_variance": np.ravel(state.innovation_variance),
            "outcome": state.outcome,
        }
    return found


def slopes_by_differences(one):
    """Whether the filter's Jacobian comes from differences: effects, diodes and amplifiers."""
    plain = all(circuit.drive.kind == "voltage" and circuit.drive.diode_V is None for circuit in one.circuits)
    return bool(one.effects) or not plain


def bound(one):
    """Least deviations that a filter can reach."""
    found = ff.error_bound(one)
    return {
        "sensors": found.sensors,
        "deviation": dict(zip(found.names, found.deviations.T, strict=True)),
        "observed": found.observed,
    }


def fit(name, law=None):
    """A fit of a stored sweep; laws without what each number of the drawing changes, which takes long."""
    table = ff.read_sweep(INPUTS / "sweeps" / name)
    return ff.fit_model(replace(table, signatures=None) if law else table, law=law)


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


def bench_file(name):
    """A stored bench table."""
    return INPUTS / "benches" / f"{name}.csv"


def bench(of, data, *, alone=False):
    """What a measurement says of a model; what a diagnosis names is added.

    Left out: where a size is largest (two places are as far), what ties, which rounding decides; and of families that
    these data do not determine (``alone``) all sizes.
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
    for effect in filter(None, (*diagnosis["missing"], diagnosis["dominant"])):
        del effect["tied_words"], effect["tie"]
    diagnosis["look_alikes"] = sorted(diagnosis["look_alikes"])
    diagnosis["ranking"] = {effect.pop("name"): effect for effect in map(dict, diagnosis["ranking"])}
    result = {"names": names, "diagnose": diagnosis}
    if isinstance(added, ff.AddResult):
        data = added.to_dict()
        for size in (sizes := [dict(size) for size in data["sizes"]]):
            del size["distance_m"], size["current_A"]
        result["add"] = data | {"sizes": sizes}
    elif added:
        result["add"] = added
    return {"fitted": {"compare": comparison}, "searched": result}


def record_file(name):
    """A stored record over time."""
    return INPUTS / "records" / f"{name}.csv"


def observed(of, name, **options):
    """A record through filters."""
    seen = ff.observe(model(of), record_file(name), **options)
    table = {key: values.to_numpy()[::50] for key, values in seen.table.items()}
    return seen.to_dict() | {"series": table, "findings": [one.code for one in seen.findings]}


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


def imported(name, **options):
    """A table of another program."""
    table = ff.import_table(INPUTS / "tables" / name, **options)
    mapping = [(one.name, one.header, one.unit, one.factor) for one in table.mapping]
    return {"columns": columns_of(table.rows), "mapping": mapping, "findings": _codes(table.findings)}


def measured(path):
    """A measurement as it is read."""
    data = ff.read_measurement(path)
    return {
        "kind": type(data).__name__,
        "given": data.given,
        "columns": columns_of(data.rows),
        "findings": _codes(data.findings),
    }


def drawn(name):
    """A FEMM model as a drawing."""
    found = import_fem_file(INPUTS / "fem" / f"{name}.fem")
    return {"drawing": tomllib.loads(found.toml), "facts": found.as_dict() | {"findings": _codes(found.findings)}}


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
        tracker.step([1.0] * n, [0.0] * len(e.SENSORS))
    found[kind] = [tracker.mean, tracker.deviations()]
print(json.dumps(found))
"""


def exported(name, directory):
    """Numbers of an exported model, in a process that does not see this package."""
    one = model(name)
    done, box = ff.export(one, directory), one.validity
    currents = box.current_limits_A.mean(axis=1)[: len(one.circuits)].tolist()
    first = json.dumps([0.5 * (box.distance_min_m + box.distance_max_m), 0.0, *currents])
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    run = [sys.executable, "-c", EXPORTED, first]
    found = json.loads(subprocess.run(run, cwd=directory, env=environment, check=True, capture_output=True).stdout)
    assert Path(found.pop("file")).is_relative_to(Path(directory).resolve())
    return {"target": done.target, "numbers": found}


def drawing(name):
    """A stored actuator file."""
    return INPUTS / "drawings" / f"{name}.toml"


def audited(name, table):
    """Conclusions of an audit by their codes; what is recomputed as rounding is zero."""
    found = {}
    for one in audit_model(model(name), table).findings:
        numbers = [0.0 if value and abs(value) < 1e-7 else value for value in (one.stated, one.recomputed)]
        found.setdefault(one.code, []).append([one.severity, *numbers])
    return found


def tolerances(name, **at):
    """Scatter of a series by the drawing's tolerances."""
    found = ff.analyse_tolerances(INPUTS / "sweeps" / name, **at)
    shares = {one.number.name: [one.gradient, one.share] for one in found.shares}
    return {"value": found.value, "scatter": found.scatter, "shares": shares}


def simulated(name, **options):
    """An open loop: what happened, and a part of its table."""
    found = ff.simulate(model(name), **options)
    facts = found.to_dict()
    del facts["energy"]["remainder_J"]  # of rounding
    return facts | {"table": {key: values[::100] for key, values in found.table.items()}}


def closed(name, plant=None, **options):
    """A closed loop with its design and margins."""
    found = ff.close_loop(model(name), plant=plant and model(plant), **options)
    data = found.data() | {"ends": found.result.series.distance_m[-1]}
    return {"settled": {"design": data.pop("design")}, "bits": data}


def calibrated(name, bench, directory, numbers):
    """A drawing's number found from a bench table; its field is solved."""
    return ff.calibrate(drawing(name), bench_file(bench), directory, numbers=numbers, workers=1).to_dict()
