"""The directory of an export: written whole or not at all, and over an earlier export alone."""

import shutil
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from femfit.core.errors import RunDirectoryError
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import write_model

NEW = ".femfit_export.partial"
"""What an export that was interrupted leaves behind; the next one takes it away."""


def write_directory(model: ActuatorModel, directory: Path, texts: Mapping[str, str], mark: str) -> tuple[Path, ...]:
    """Write files by their names, and the model and the licence beside them; all of them.

    Parameters
    ----------
    mark : str
        The file that shows an earlier export.

    Raises
    ------
    RunDirectoryError
        If the directory is a file, or holds something else.
    """
    directory = Path(directory)
    _require_free(directory, mark)
    licence = _licence()
    texts = dict(texts) if licence is None else {**texts, "LICENSE": licence}
    new, absent = directory / NEW, not directory.exists()
    shutil.rmtree(new, ignore_errors=True)
    try:
        new.mkdir(parents=True)  # refused where somebody laid a link in its place
        for name, text in texts.items():
            (new / name).write_text(text, encoding="utf-8")
        write_model(model, new / "model.json")
        for file in sorted(new.iterdir(), key=lambda file: file.name == mark):  # the mark last
            file.replace(directory / file.name)
    except OSError as error:
        place = str(error.filename or directory).replace(str(new), str(directory))  # a full disk names no file
        raise OSError(error.errno, error.strerror, place) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)
        if absent and directory.exists() and not any(directory.iterdir()):
            directory.rmdir()
    return tuple(directory / name for name in (*texts, "model.json"))


def _require_free(directory: Path, mark: str) -> None:
    if not directory.exists():
        return
    if not directory.is_dir():
        raise RunDirectoryError(f"{directory} must be a directory to export to; it is a file. Choose another name.")
    earlier = any((directory / name).exists() for name in (mark, NEW, "femfit_runtime/__init__.py"))
    if any(directory.iterdir()) and not earlier:
        raise RunDirectoryError(
            f"{directory} must be absent, empty or an earlier export with {mark}; it holds other files. Choose another "
            "directory."
        )


def _licence() -> str | None:
    """Text of the licence that the installed femfit carries."""
    try:
        return distribution("femfit").read_text("licenses/LICENSE")
    except PackageNotFoundError:
        return None
