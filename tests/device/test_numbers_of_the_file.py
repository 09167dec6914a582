"""Every number that the file may hold can be swept and be off, or the reason why not is said."""

from femfit.device import schema, schema_device
from femfit.device.schema_device import SENSORS, TABLES, CurveEntry, MaterialEntry
from femfit.device.tolerances import read_tolerances

KINDS = {"materials": {"linear": MaterialEntry, "curve": CurveEntry}, "sensors": SENSORS}
PLACES = {
    ".".join((*above, last.replace("*", name))): entry
    for (*above, last), only in TABLES.items()
    for name, entry in KINDS.get(above[0] if above else "", {"named": only}).items()
}

OF_THE_GRID = {"RangeEntry", "SweepEntry", "CurrentAxis", "DistanceAxis", "DesignEntry", "KeyEntry", "ValuesEntry",
               "NamedParameterEntry", "SampledEntry", "FrequencyRangeEntry", "ToleranceEntry"}  # fmt: skip
BASES = {"Entry", "OutlineEntry", "HallPlace", "SensorTiming", "ConductorEntry", "FileEntry", "ElectromagnetEntry"}


def _number_keys(entry):
    """Keys of an entry that hold a number or numbers, after its JSON schema, with an example of each."""
    definition = entry.model_json_schema()
    for key, field in definition.get("properties", {}).items():
        example = _example(field)
        if example is not None:
            yield key, example


def _example(field):
    for one in field.get("anyOf", [field]):
        if one.get("type") in {"number", "integer"}:
            return 1.0
        if one.get("type") == "array" and (inner := _example(one.get("items", {}))) is not None:
            return [inner, inner]
    return None


def _leaves(path, value):
    if not isinstance(value, list):
        return [path]
    return [leaf for k, one in enumerate(value) for leaf in _leaves(f"{path}[{k}]", one)]


def _data_and_paths():
    data, paths = {"schema": 2, "sweep": {}}, []
    for place, entry in PLACES.items():
        table = data
        for key in place.split("."):
            table = table.setdefault(key, {})
        if place.startswith("sensors."):
            table["kind"] = place.partition(".")[2]
        for key, example in _number_keys(entry):
            if isinstance(example, list):  # a single number that the file leaves out is one as well
                table[key] = example
            paths += _leaves(f"{place}.{key}", example)
    return data, paths


def test_the_walk_knows_every_table_of_the_file():
    modules = (schema, schema_device)
    entries = {
        name
        for module in modules
        for name, one in vars(module).items()
        if isinstance(one, type) and issubclass(one, schema.Entry) and list(_number_keys(one))
    }
    assert entries - OF_THE_GRID - BASES == {one.__name__ for one in PLACES.values()} - BASES


def test_every_number_of_the_file_may_be_off_or_the_reason_is_said():
    data, paths = _data_and_paths()
    assert len(paths) > 120
    for path in paths:
        problems = []
        given, _ = read_tolerances({**data, "tolerances": {path: 0.1}}, problems)
        refused = path.startswith(("thermal.", "solver.", "reference.")) or path.endswith("bits")
        assert (given == {path: 0.1}) is not refused, (path, problems)
        assert not refused or path in problems[0]
