"""The journal: a disk that is full for a while, two processes, lines cut short anywhere."""

import json
import zlib

import pytest

from femfit.core.errors import RunDirectoryError
from femfit.core.journal import JOURNAL_NAME, Journal, JournalHeader, holds

HEADER = JournalHeader("a" * 64, {"the drawing": "a"})
RESULTS = {str(n): {"status": "ok", "force_N": n / 3.0} for n in range(5)}


def recorded(directory, *keys):
    with Journal(directory, HEADER) as journal:
        for key in keys:
            journal.record(key, RESULTS[key])
    return directory / JOURNAL_NAME


def test_results_wait_in_memory_while_the_disk_is_full_and_are_written_when_there_is_room(tmp_path, largest_file):
    with Journal(tmp_path, HEADER) as journal:
        journal.record("0", RESULTS["0"])
        room = (tmp_path / JOURNAL_NAME).stat().st_size
        largest_file(room + 10)
        for key in ("1", "2"):
            journal.record(key, RESULTS[key])
            assert (tmp_path / JOURNAL_NAME).stat().st_size == room  # no half line is left
        assert (len(journal.finished), journal.on_disk) == (3, 1)
        largest_file(None)
        journal.record("3", RESULTS["3"])
        assert (len(journal.finished), journal.on_disk) == (4, 4)
    with Journal(tmp_path, HEADER) as again:
        assert list(again.finished.items()) == list(RESULTS.items())[:4]


def test_a_disk_that_is_full_from_the_start_holds_nothing_and_loses_nothing(tmp_path, largest_file):
    largest_file(10)
    with Journal(tmp_path, HEADER) as journal:
        journal.record("0", RESULTS["0"])
        assert journal.on_disk == 0
        largest_file(None)
        journal.record("1", RESULTS["1"])
        assert journal.on_disk == 2
    assert len((tmp_path / JOURNAL_NAME).read_bytes().splitlines()) == 3


def test_only_the_parts_that_differ_have_changed_and_of_an_earlier_version_no_part_is_known(tmp_path):
    settings = {"the settings": "s"}
    for hashed, parts, changed in (
        ("a", {"the drawing": "1", **settings}, ()),
        ("b", {"the drawing": "2", **settings}, ("the drawing",)),
        ("a", {"the drawing": "1", **settings}, ()),  # which is taken up again
    ):
        with Journal(tmp_path, JournalHeader(64 * hashed, parts)) as journal:
            assert journal.changed == changed
    (tmp_path / JOURNAL_NAME).write_text(json.dumps({"configuration_hash": 64 * "c"}) + "\n")
    with Journal(tmp_path, JournalHeader(64 * "d", settings)) as journal:
        assert journal.changed == ("the version of femfit",)


def test_a_directory_in_use_is_refused_until_its_process_ends(tmp_path):
    with Journal(tmp_path, HEADER), pytest.raises(RunDirectoryError, match="in use by another femfit process"):
        Journal(tmp_path, HEADER)
    Journal(tmp_path, HEADER).__exit__(None, None, None)


def test_a_journal_cut_anywhere_gives_back_its_whole_lines(tmp_path):
    path = recorded(tmp_path, *RESULTS)
    content = path.read_bytes()
    for length in range(0, len(content), 13):
        path.write_bytes(content[:length])
        with Journal(tmp_path, HEADER) as journal:
            whole = max(content[:length].count(b"\n") - 1, 0)
            assert journal.finished == {str(n): RESULTS[str(n)] for n in range(whole)}
            for key in list(RESULTS)[whole:]:
                journal.record(key, RESULTS[key])
        assert path.read_bytes() == content


@pytest.mark.parametrize("header", [{"configuration_hash": "abc", "parts": [1]}, {"configuration_hash": None}, {}])
def test_a_damaged_first_line_is_no_journal_of_any_drawing_and_is_said(header, tmp_path):
    (tmp_path / JOURNAL_NAME).write_text(json.dumps(header) + "\n")
    assert not holds(tmp_path, "a" * 64)
    with Journal(tmp_path, HEADER) as journal:
        (said,) = journal.changed
        assert "damaged" in said
        journal.record("0", RESULTS["0"])
    assert [file.name for file in tmp_path.iterdir()] == [JOURNAL_NAME]
    with Journal(tmp_path, HEADER) as again:
        assert (again.finished, again.changed) == ({"0": RESULTS["0"]}, ())


def item(key, result):
    """A line whose checksum is right."""
    return json.dumps({"key": key, "result": result, "checksum": zlib.crc32(json.dumps([key, result]).encode())})


WHOLE = item("1", RESULTS["1"])
DAMAGED = [
    '{"result": {"status": "ok"}}',
    '{"key": "1", "result": {"status": "ok", "force_N": 0.333}}',
    "[]",
    *(WHOLE.replace(repr(1 / 3), number) for number in ("0.4", "NaN", "-Infinity")),
    *(item(key, result) for key, result in [([1], {"status": "ok"}), ("1", [1]), ("1", 2.0), (None, None)]),
]


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_line_is_dropped_with_what_follows_it(damage, tmp_path):
    path = recorded(tmp_path, "0", "1", "2")
    text = path.read_text()
    assert WHOLE in text
    path.write_text(text.replace(WHOLE, damage))
    with Journal(tmp_path, HEADER) as again:
        assert again.finished == {"0": RESULTS["0"]}
