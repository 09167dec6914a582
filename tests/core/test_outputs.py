"""No command writes over what it reads, nor over a file of another kind."""

import errno
import json

import pytest

from femfit.core import files
from femfit.core.errors import OutputError
from femfit.core.files import replacing, require_outputs, write_json, write_text
from support.command import python

LOOP = "run,time_s,estimated_distance_m\n1,0,0.02\n"
MINE = '{"verdict": "agrees", "written_by": "femfit 0.1.0"}'
TAKEN = [
    ("empty.json", "", files.MODEL),
    ("c.json", MINE, files.RESULT),
    ("o.csv", "time_s,coil_voltage_V,field_T,field_sigma_T,offset_V\n0,0,0,0,0\n", None),
    ("loop.csv", LOOP, files.LOOP),
    ("absent.json", None, files.RESULT),
]
KEPT = [
    ("package.json", '{"name": "mine"}', files.RESULT, ""),
    ("thesis.html", "<!DOCTYPE html><html><p>Chapter 1</p></html>", files.PAGE, ""),
    ("bench.csv", "current_A,distance_m,force_N\n0.1,0.02,0.03\n", None, ""),
    ("bench.toml", "force_N = 2e-4\n", files.NOTES, ""),
    ("rig.toml", "# my own drawing\n[coil]\nturns = 1\n", files.DRAWING, ""),
    ("record.bin", "\0\1\2\3", files.INTEGRATED, ""),
    ("loop.csv", LOOP, files.INTEGRATED, " as an integrated record"),
    ("rig", "[coil]\nturns = 1\n", files.MODEL, " as a model file"),
    ("model.json", '{"magnetics": {}, "validity": {}}', files.RESULT, " as a JSON result"),
    ("c.json", MINE, files.MODEL, " as a model file"),
]


@pytest.mark.parametrize(("name", "text", "kind"), TAKEN)
def test_free_names_and_earlier_results_of_the_same_kind_are_taken(tmp_path, name, text, kind):
    if text is not None:
        (tmp_path / name).write_text(text)
    require_outputs([tmp_path / "m.json"], (tmp_path / name, kind), (None, files.PAGE))


@pytest.mark.parametrize(("name", "text", "kind", "words"), KEPT)
def test_a_file_of_another_kind_is_refused(tmp_path, name, text, kind, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(OutputError, match=f"not written by femfit{words}"):
        require_outputs([], (tmp_path / name, kind))


@pytest.mark.parametrize("name", ["in.json", "sub/../in.json", "link.json"])
def test_an_input_is_not_replaced_whatever_it_is_called(tmp_path, name):
    (tmp_path / "sub").mkdir()
    (tmp_path / "in.json").write_text("{}")
    (tmp_path / "link.json").symlink_to(tmp_path / "in.json")
    with pytest.raises(OutputError, match="reads"):
        require_outputs([tmp_path / "in.json", None], (tmp_path / name, files.RESULT))


def test_two_results_need_two_files_a_directory_is_kept_and_a_device_is_written_to(tmp_path):
    path = tmp_path / "a.json"
    with pytest.raises(OutputError, match="two results"):
        require_outputs([], (path, files.MODEL), (path, files.RESULT))
    with pytest.raises(OutputError, match="directory"):
        require_outputs([], (tmp_path, files.RESULT))
    (tmp_path / "null.csv").symlink_to("/dev/null")
    require_outputs([], (tmp_path / "null.csv", files.LOOP))


@pytest.mark.parametrize("kind", [files.LOOP, files.INTEGRATED])
def test_a_sweep_table_is_not_replaced_by_a_record(tmp_path, kind):
    (tmp_path / "manifest.json").write_text('{"name": "rig"}')
    (tmp_path / "sweep.csv").write_text("distance_m,current_A,force_N\n0.02,0.1,0.03\n")
    with pytest.raises(OutputError, match="not written by femfit"):
        require_outputs([], (tmp_path / "sweep.csv", kind))
    require_outputs([], (tmp_path / "sweep.csv", files.SWEEP))


def test_a_file_that_is_written_has_the_suffix_the_permissions_and_the_whole_name_of_its_target(tmp_path):
    with replacing(tmp_path / "picture.png") as partial:
        assert partial.suffix == ".png"
        partial.write_bytes(b"x")
    assert (tmp_path / "picture.png").read_bytes() == b"x"
    path = tmp_path / "secret.json"
    path.write_text("old")
    path.chmod(0o600)
    write_text(path, "new")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("new", 0o600)
    path = tmp_path / f"{'n' * 250}.txt"
    write_text(path, "x")
    assert path.read_text() == "x"


def test_links_stay_devices_are_written_to_directly_and_a_full_one_is_named(tmp_path):
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    link.symlink_to(real)
    write_text(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"
    link = tmp_path / "out.json"
    link.symlink_to("/dev/null")
    write_text(link, "gone")
    assert link.is_symlink()
    with pytest.raises(OSError, match="/dev/full") as full:
        write_text("/dev/full", "x")
    assert full.value.errno == errno.ENOSPC


def fail_half_way(path):
    with replacing(path) as partial:
        partial.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("kept", [None, "earlier"])
def test_a_full_disk_names_the_target_and_keeps_the_earlier_file(tmp_path, kept):
    path = tmp_path / "out.csv"
    if kept:
        path.write_text(kept)
    with pytest.raises(OSError, match="No space") as caught:
        fail_half_way(path)
    assert caught.value.filename == str(path)
    assert [file.read_text() for file in tmp_path.iterdir()] == ([kept] if kept else [])


def test_what_stands_in_the_way_is_named_before_anything_is_written(tmp_path):
    with pytest.raises(IsADirectoryError), replacing(tmp_path):
        pytest.fail("nothing may be written")
    with pytest.raises(IsADirectoryError):
        write_text(f"{tmp_path}/new/", "x")
    (tmp_path / "file").write_text("x")
    path = tmp_path / "file" / "out.json"
    with pytest.raises(FileExistsError, match="file"):
        write_text(path, "x")


def test_json_that_is_written_is_strict(tmp_path):
    """A share that was not computed is NaN in Python and null in JSON, which browsers and strict parsers read."""
    path = tmp_path / "new" / "result.json"
    write_json(path, {"share": float("nan"), "sizes": (1.0, float("inf")), "name": "a"})
    strictly = json.loads(path.read_text(), parse_constant=pytest.fail)
    assert strictly == {"share": None, "sizes": [1.0, None], "name": "a"}


def test_the_names_that_files_begin_with_differ_and_are_new(tmp_path):
    with replacing(tmp_path / "a.csv") as first, replacing(tmp_path / "a.csv") as second:
        assert first != second
        assert first.read_bytes() == second.read_bytes() == b""
        (tmp_path / "plain").touch()
        assert first.stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_what_is_written_to_a_pipe_arrives(tmp_path):
    assert python("from femfit.core.files import write_text; write_text('/dev/stdout', 'whole')") == "whole"
