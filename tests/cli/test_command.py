"""What every command has: options that are the library's keywords, and a result that is printed and written."""

import inspect
import json
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Literal, get_args, get_origin

import pytest

import femfit.cli
from femfit import PLACES
from femfit.cli.command import MeasurementOptions, Outcome, TableOptions, command
from femfit.cli.keywords import Keyword, Keywords
from femfit.core.errors import OutputError, UsageError

MODULES = [import_module(f"femfit.cli.{path.stem}") for path in Path(femfit.cli.__file__).parent.glob("[a-z]*.py")]
GROUPS = [value for module in MODULES for value in vars(module).values() if isinstance(value, Keywords)]
GROUPS += [kind.__metadata__[0] for kind in (TableOptions, MeasurementOptions)]
ENTRIES = [
    pytest.param(PLACES.get(group.function, group.function), entry, id=f"{group.function}-{entry.name}")
    for group in GROUPS
    for entry in group.entries
]


def choices(annotation):
    """The values of a Literal, None left out."""
    if get_origin(annotation) is Literal:
        return set(get_args(annotation))
    return set().union(*map(choices, get_args(annotation))) if isinstance(annotation, UnionType) else set()


@pytest.mark.parametrize(("place", "entry"), ENTRIES)
def test_an_option_has_default_values_and_type_of_the_keyword(place, entry):
    module, _, name = place.partition(":")
    keyword = inspect.signature(getattr(import_module(module), name)).parameters[entry.name]
    if entry.default is not None:
        assert entry.default == keyword.default
    asked = get_args(entry.parameter.annotation)[0]
    assert choices(asked) == choices(keyword.annotation) or not choices(asked)
    assert entry.text[0].isupper()
    assert entry.text.endswith(".")
    assert "`" not in entry.text


STILL = Keyword("still_m", "still-um", "float >= 0", "float", "Largest change of the distance.", 2.5e-6)
MAPPED = "mapping of str to float"
LASER = Keyword("noise", "noise", f"float, {MAPPED}, or None", MAPPED, "Noise as laser=0.002.", None)


def test_default_and_limits_are_said_in_the_unit_of_an_option():
    assert get_args(STILL.parameter.annotation)[1].help == "Largest change of the distance. [default: 2.5]"
    assert STILL.value(2.5) == pytest.approx(STILL.default)
    near = Keyword("gap_m", "gap-mm", "float > 0 and <= 0.5", "float", "Gap.", None)
    (limits,) = get_args(near.parameter.annotation)[1].validator
    assert (limits.gt, limits.lte) == (0.0, 500.0)


def test_names_and_numbers_that_are_given_become_what_the_function_takes():
    assert LASER.value(("laser=0.1,hall=2", "bias=3")) == {"laser": 0.1, "hall": 2.0, "bias": 3.0}
    assert LASER.value(("0.5",)) == 0.5
    unclear = {"laser=": "NAME=NUMBER; instead received 'laser='.*laser=0.002", "": "NUMBER", " , ": "NUMBER"}
    for given, words in unclear.items():  # blank as of a shell's variable that is not set: not zero, not all sensors
        with pytest.raises(UsageError, match=f"--noise must read {words}"):
            LASER.value((given,))


def test_what_is_not_given_is_left_to_the_function_and_a_zero_is_given():
    drive = next(group for group in GROUPS if group.function == "simulate")
    assert drive.arguments({"option_start_m": 0.0, "option_voltage_V": (), "model": "m"}) == {"start_m": 0.0}


def test_a_docstrings_text_reads_as_a_command_line():
    (where, *_), (bounds,) = (
        [e for t in GROUPS for e in t.entries if e.name == name][:1] for name in ("where", "bounds")
    )
    assert "as variant=3, coil.turns=250 or" in where.text
    assert bounds.text.endswith("as d^-4=0:1e-8.")


def test_a_result_whose_page_cannot_be_written_is_told_and_kept_as_json(tmp_path, capsys):
    class Found:
        def to_dict(self):
            return {"distance_m": 0.02}

        def __str__(self):
            return "20 mm"

    def page(path):
        raise OutputError(f"{path} cannot be written")

    @command()
    def measure(report: Path) -> Outcome:
        return Outcome(Found(), files=[(report, page)])

    with pytest.raises(OutputError):
        measure(tmp_path / "page.html", json=tmp_path / "result.json")
    assert capsys.readouterr().out == "20 mm\n"
    assert json.loads((tmp_path / "result.json").read_text())["distance_m"] == 0.02
