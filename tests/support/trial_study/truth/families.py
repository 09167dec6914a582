"""Families of field solutions: the drawing as it is, and with one thing changed by one number.

Where everything is linear, fields are at most quadratic in a remanence, so three solutions give every value exactly; a
bore's eccentricity enters by its square; saturation and the holder's iron are blended with the drawing.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from femfit.core.errors import MissingPartError
from femfit.device.parts import Actuator
from femfit.trial import drawing_variants as drawn
from femfit.trial.device import Family
from femfit.trial.field_table import FieldTable, solve_drawings

_ECCENTRICITY = (0.5, 0.8)
"""Of the clearance."""

REMANENCE_STEP, LAYER_STEP, CORE_STEP = 0.1, 0.5, 0.02
_POLARISATION_T = {1.0: 0.6, 2.5: 0.45}
"""Ferrite: J_s by the sharpness of the knee; NiZn and MnZn grades hold 0.25 to 0.5 T."""


@dataclass(frozen=True, eq=False)
class Truth:
    """The field solutions of one actuator.

    Parameters
    ----------
    families : mapping of str to Family
        Those asked for of ``magnets`` (relative change of every remanence), ``layer`` (of the magnet's third next to
        the gap), ``core`` (remanence of all fixed iron along the axis in T), ``memory`` (that along the winding's
        flux), ``ring`` (iron of a holder), ``bore`` (squared
        eccentricity in m^2), ``saturation-N`` (for each sharpness N).
    """

    actuator: Actuator
    base: FieldTable
    families: Mapping[str, Family]


def family_drawings(actuator: Actuator) -> dict[str, dict[float, Actuator]]:
    """The drawings of every family that an actuator admits, by p; 0 where its reference is not the drawing."""
    steps = (-CORE_STEP, CORE_STEP)
    result = {}
    if any(map(drawn.is_soft, actuator.fixed)):
        result["core"] = {step: drawn.remanent_core(actuator, step) for step in steps}
        result["memory"] = {step: drawn.remembering_core(actuator, step) for step in steps}
    if drawn.has_magnet(actuator):
        result["magnets"] = {step: drawn.scaled_magnets(actuator, step) for step in (-REMANENCE_STEP, REMANENCE_STEP)}
        result["layer"] = {step: drawn.weak_layer(actuator, step) for step in (-LAYER_STEP, -2.0 * LAYER_STEP)}
    try:
        _, bore, plunger = drawn.plunger_bore(actuator)
    except MissingPartError:
        result["ring"] = {0.0: drawn.without_magnets(actuator), 1.0: drawn.with_iron_ring(actuator)}
    else:
        offsets = [share * (bore - plunger) for share in _ECCENTRICITY]
        result["bore"] = {offset**2: drawn.eccentric_bore(actuator, offset) for offset in offsets}
        result["ring"] = {1.0: drawn.with_bore(actuator, plunger + 1.3 * (bore - plunger))}
    soft = any(map(drawn.is_linear_iron, (*actuator.fixed, *actuator.moving.regions)))
    for sharpness, polarisation in _POLARISATION_T.items() if soft else ():
        result[f"saturation-{sharpness:g}"] = {1.0: drawn.saturable_core(actuator, polarisation, sharpness)}
    return result


def load_truth(actuator: Actuator, cache: Path, families: Collection[str] | None = None, workers: int = 2) -> Truth:
    """The field solutions of an actuator, from the cache or solved.

    Parameters
    ----------
    families : collection of str or None
        Those needed; all that the drawing admits where None.
    """
    wanted = {
        name: members for name, members in family_drawings(actuator).items() if families is None or name in families
    }
    drawings = {"base": actuator} | {
        f"{name}{value:+.3g}": drawing for name, members in wanted.items() for value, drawing in members.items()
    }
    tables = solve_drawings(drawings, cache / f"fields-{actuator.name}", workers=workers)
    result = {}
    for name, members in wanted.items():
        values = tuple(value for value in members if value != 0.0)
        reference = tables[f"{name}+0"] if 0.0 in members else tables["base"]
        result[name] = Family(values, tuple(tables[f"{name}{value:+.3g}"] for value in values), reference)
    return Truth(actuator, tables["base"], result)
