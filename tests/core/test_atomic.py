"""Files are written whole or not at all."""

import errno
import json
import subprocess
import sys

import pytest

from femfit.core.files import replacing, write_json, write_text


def fail_half_way(path, error):
    with replacing(path) as partial:
        partial.write_text("half")
        raise error


def test_an_error_while_writing_leaves_the_earlier_file(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("earlier")
    with pytest.raises(RuntimeError):
        fail_half_way(path, RuntimeError())
    assert path.read_text() == "earlier"
    assert [file.name for file in tmp_path.iterdir()] == ["table.csv"]


def test_the_file_written_to_has_the_suffix_of_its_target(tmp_path):
    with replacing(tmp_path / "picture.png") as partial:
        assert partial.suffix == ".png"
        partial.write_bytes(b"x")
    assert (tmp_path / "picture.png").read_bytes() == b"x"


def test_a_symbolic_link_stays_one(tmp_path):
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    link.symlink_to(real)
    write_text(link, "new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_a_device_is_written_to_directly(tmp_path):
    link = tmp_path / "out.json"
    link.symlink_to("/dev/null")
    write_text(link, "gone")
    assert link.is_symlink()


@pytest.mark.parametrize("kept", [None, "earlier"])
def test_a_full_disk_names_the_target_and_keeps_the_earlier_file(tmp_path, kept):
    path = tmp_path / "out.csv"
    if kept:
        path.write_text(kept)
    with pytest.raises(OSError, match="No space") as caught:
        fail_half_way(path, OSError(errno.ENOSPC, "No space left on device"))
    assert caught.value.filename == str(path)
    assert [file.read_text() for file in tmp_path.iterdir()] == ([kept] if kept else [])


def test_a_directory_in_the_way_is_named_before_anything_is_written(tmp_path):
    with pytest.raises(IsADirectoryError), replacing(tmp_path):
        pytest.fail("nothing may be written")


def test_json_that_is_written_is_strict(tmp_path):
    """A share that was not computed is NaN in Python and null in JSON, which browsers and strict parsers read."""
    path = tmp_path / "new" / "result.json"
    write_json(path, {"share": float("nan"), "sizes": (1.0, float("inf")), "name": "a"})

    def refuse(constant):
        pytest.fail(f"{constant} is no JSON")

    assert json.loads(path.read_text(), parse_constant=refuse) == {"share": None, "sizes": [1.0, None], "name": "a"}


def test_the_names_that_files_begin_with_differ_and_are_new(tmp_path):
    with replacing(tmp_path / "a.csv") as first, replacing(tmp_path / "a.csv") as second:
        assert first != second
        assert first.read_bytes() == second.read_bytes() == b""
        (tmp_path / "plain").touch()
        assert first.stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_what_is_written_to_a_pipe_arrives(tmp_path):
    code = "from femfit.core.files import write_text; write_text('/dev/stdout', 'whole')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "whole"


def test_a_file_that_is_replaced_keeps_its_permissions(tmp_path):
    path = tmp_path / "secret.json"
    path.write_text("old")
    path.chmod(0o600)
    write_text(path, "new")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("new", 0o600)


def test_links_in_a_circle_and_a_directory_to_be_are_refused_and_nothing_is_made(tmp_path):
    loop = tmp_path / "loop.json"
    loop.symlink_to(loop)
    with pytest.raises(OSError, match=r"loop\.json") as circle:
        write_text(loop, "x")
    assert circle.value.errno == errno.ELOOP
    with pytest.raises(IsADirectoryError):
        write_text(f"{tmp_path}/new/", "x")
    assert loop.is_symlink()
    assert [file.name for file in tmp_path.iterdir()] == ["loop.json"]


def test_a_file_in_place_of_a_directory_is_the_error_that_is_reported(tmp_path):
    (tmp_path / "file").write_text("x")
    path = tmp_path / "file" / "out.json"
    with pytest.raises(FileExistsError, match="file"):
        write_text(path, "x")


def test_a_name_as_long_as_the_system_allows_is_written(tmp_path):
    path = tmp_path / f"{'n' * 250}.txt"
    write_text(path, "x")
    assert path.read_text() == "x"


def test_a_full_device_is_named():
    with pytest.raises(OSError, match="/dev/full") as full:
        write_text("/dev/full", "x")
    assert full.value.errno == errno.ENOSPC
