"""A message about a missing column ends with an option that a shell takes as it stands."""

import shlex
from itertools import pairwise

import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.tables.columns import column_option
from femfit.tables.measurement_file import read_measurement
from tests.support.solenoids import solenoid

HEADERS = [
    "CH1 voltage (V)",
    "Bob's coil [V]",
    'the "old" coil [V]',
    "$V_out [V]",
    "100 % [V]",
    "U\\I [V]",
    "A=B",
    "Kanal",
]


def options_in(message):
    """Header to column, as a shell and the command line take them out of a message."""
    words = shlex.split(message[message.index("--column") :].rstrip("."))
    options = [after for option, after in pairwise(words) if option == "--column"]
    return dict(text.rpartition("=")[::2] for text in options)


def refusal(read, path):
    with pytest.raises(TableError) as refused:
        read(path)
    return options_in(str(refused.value)), str(refused.value).count("--column")


@pytest.mark.parametrize("header", HEADERS)
def test_a_shell_reads_the_header_as_the_file_has_it(header, tmp_path):
    assert options_in(column_option(header, "voltage_V")) == {header: "voltage_V"}
    if '"' not in header:  # which would be a quoted cell
        path = tmp_path / "scope.csv"
        path.write_text("\n".join([f"Time (s),{header}", *(f"{1e-3 * k:g},{k % 3}" for k in range(9))]))
        options, _ = refusal(read_measurement, path)
        assert list(options) == [header]
        assert "voltage_V" in read_measurement(path, columns=options).given


def test_columns_are_offered_by_their_words_before_their_units(tmp_path):
    path = tmp_path / "scope.csv"
    path.write_text(
        "Time (s),trigger [V],CH1 voltage (V),CH2 current (A)\n" + "".join(f"{k},0,{k},1\n" for k in "0123")
    )
    options, _ = refusal(read_measurement, path)
    assert (options["CH1 voltage (V)"], options["CH2 current (A)"]) == ("voltage_V", "current_A")


def test_a_column_that_is_not_used_is_offered_where_its_words_say_what_it_may_be(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("distance_mm,current_A,Kraft ges. [N],note\n" + "".join(f"{k},1,{k},x\n" for k in range(2, 6)))
    assert refusal(read_measurement, path)[0] == {"Kraft ges. [N]": "force_N"}
    table = read_measurement(
        path, columns={"note": "force_N", "Kraft ges. [N]": "hall_V"}, units={"Kraft ges. [N]": "V"}
    )
    assert "unused-column" not in {one.code for one in table.findings}


@pytest.mark.parametrize("header", ["V", "Spannung am Ventil [mV]"])
def test_a_filter_without_its_command_is_told_the_option_once(tmp_path, header):
    path = tmp_path / "scope.csv"
    path.write_text(f"t [s],{header},i [A]\n" + "".join(f"{k / 10},{k},1\n" for k in range(9)))
    assert refusal(lambda path: ff.observe(solenoid(), path), path) == ({header: "voltage_V"}, 1)
