"""Drawings to start from."""

from importlib.resources import files


def starter_names() -> tuple[str, ...]:
    """Names of the drawings, in alphabetical order."""
    found = (entry.name for entry in files("femfit.device.examples").iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in found if name.endswith(".toml")))


def starter_text(name: str, title: str | None = None) -> str:
    """The actuator file of a drawing, under a name of its own where one is given."""
    text = files("femfit.device.examples").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return text if title is None else text.replace(f'name = "{name}"', f'name = "{title}"', 1)
