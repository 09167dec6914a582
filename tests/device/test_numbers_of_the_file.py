"""Every number that the file may hold can be swept and be off, or the reason why not is said."""

import pytest

from femfit.device.schema_device import SENSORS, TABLES, CurveEntry, MaterialEntry
from femfit.device.tolerances import read_tolerances

KINDS = {"materials": {"linear": MaterialEntry, "curve": CurveEntry}, "sensors": SENSORS}
PLACES = {
    ".".join((*above, last.replace("*", name))): entry
    for (*above, last), only in TABLES.items()
    for name, entry in KINDS.get(above[0] if above else "", {"named": only}).items()
}


def number_in(field):
    """An example of the numbers that a key holds, after its JSON schema."""
    for one in field.get("anyOf", [field]):
        if one.get("type") in {"number", "integer"}:
            return 1.0
        if one.get("type") == "array" and (inner := number_in(one.get("items", {}))) is not None:
            return [inner, inner]
    return None


def leaves(path, value):
    return [leaf for k, one in enumerate(value) for leaf in leaves(f"{path}[{k}]", one)] if value != 1.0 else [path]


@pytest.mark.parametrize("place", PLACES)
def test_every_number_of_a_table_may_be_off_or_the_reason_is_said(place):
    fields = PLACES[place].model_json_schema()["properties"]
    examples = {key: number_in(field) for key, field in fields.items()}
    lists = {
        key: example for key, example in examples.items() if isinstance(example, list)
    }  # any other may be left out
    table = {"kind": place.partition(".")[2]} | lists
    for name in reversed(place.split(".")):
        table = {name: table}
    paths = [path for key, example in examples.items() if example for path in leaves(f"{place}.{key}", example)]
    assert paths or place in {"fixed", "electromagnet"}
    for path in paths:
        problems = []
        tolerances, _ = read_tolerances({"schema": 2, "sweep": {}, "tolerances": {path: 0.1}, **table}, problems)
        refused = place in {"thermal", "solver", "reference"} or path.endswith("bits")
        assert (tolerances == {path: 0.1}) is not refused, (path, problems)
        assert not refused or path in problems[0]
