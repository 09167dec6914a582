"""The variants of a parameter sweep: each one a file of its own, checked as such."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from femfit.core.errors import ActuatorFileError
from femfit.core.paths import path_of
from femfit.device.decimals import scaled
from femfit.device.load import actuator_from_tables, parse, read_text
from femfit.device.parameter_table import read_design
from femfit.device.parameters import AXES, ParameterDesign, Value, order, shown
from femfit.device.parts import Actuator, SweepAxes


@dataclass(frozen=True)
class Variant:
    """One variant."""

    values: tuple[Value, ...]  # One a column of the sweep, in SI units or a material's name
    sweep: SweepAxes
    actuator: Actuator | None  # None if it cannot be built
    problem: str = ""


@dataclass(frozen=True)
class VariantSweep:
    """An actuator and what becomes of it when parameters change."""

    actuator: Actuator
    # Names of the parameters in the table, each ending in its SI unit; empty without parameters
    columns: tuple[str, ...]
    variants: tuple[Variant, ...]  # In the order of the design; the actuator alone without parameters


def read_variants(path: str | Path) -> VariantSweep:
    """Read an actuator file with all its variants.

    Returns
    -------
    VariantSweep
        A variant that cannot be built, as one whose parts overlap, is one with its problem.
    """
    path = path_of(path, "An actuator file")
    return variants_from_toml(read_text(path), str(path), path.parent)


def variants_from_toml(text: str, source: str = "actuator file", directory: Path | None = None) -> VariantSweep:
    """Build all variants of an actuator from TOML text; arguments and errors as of :func:`read_variants`."""
    data = parse(text, source)
    actuator = actuator_from_tables(data, source, directory)
    design = read_design(data, [])
    if design is None:
        return only(actuator)
    idle = list(_idle_parameters(design, data, directory))
    if idle:
        raise ActuatorFileError(source, idle)
    variants = tuple(_variant(design, point, data, actuator, directory) for point in design.points)
    if all(variant.actuator is None for variant in variants):
        raise ActuatorFileError(
            source, [f"sweep.parameters must leave a variant that can be built; the first one: {variants[0].problem}"]
        )
    return VariantSweep(actuator, tuple(p.column for p in design.parameters if p.name not in AXES), variants)


def only(actuator: Actuator) -> VariantSweep:
    """An actuator without parameters as a sweep of variants."""
    return VariantSweep(actuator, (), (Variant((), actuator.sweep, actuator),))


def _variant(
    design: ParameterDesign,
    point: tuple[Value, ...],
    data: dict[str, Any],
    base: Actuator,
    directory: Path | None,
) -> Variant:
    values = tuple(
        parameter.in_si(value)
        for parameter, value in zip(design.parameters, point, strict=True)
        if parameter.name not in AXES
    )
    built = _built(design.variant(data, point), directory)
    if isinstance(built, Actuator):
        return Variant(values, built.sweep, built)
    own = dict(zip((parameter.name for parameter in design.parameters), point, strict=True))
    current, distance = (own.get(name) for name in AXES)
    axes = SweepAxes(
        base.sweep.currents_A if current is None else (float(current),),
        base.sweep.distances_m if distance is None else (scaled(float(distance)),),
    )
    return Variant(values, axes, None, built)


def _built(tables: dict[str, Any], directory: Path | None) -> Actuator | str:
    """The actuator, or what is wrong with it."""
    try:
        return actuator_from_tables(tables, "variant", directory)
    except ActuatorFileError as error:
        return " ".join(error.problems)


def _idle_parameters(design: ParameterDesign, data: dict[str, Any], directory: Path | None) -> Iterator[str]:
    """A line for each parameter that makes no difference, as the wire's temperature beside a given resistance."""
    for place, parameter in enumerate(design.parameters):
        values = sorted({point[place] for point in design.points}, key=order)
        if parameter.name in AXES or len(values) < 2:
            continue
        alone = ParameterDesign((parameter,), ())
        ends = [_built(alone.variant(data, (value,)), directory) for value in (values[0], values[-1])]
        if isinstance(ends[0], Actuator) and ends[0] == ends[1]:
            yield (
                f"sweep.parameters.{parameter.name} must change the actuator; {shown(values[0])} and "
                f"{shown(values[-1])} give the same one. Remove it, or the key that overrides it."
            )
