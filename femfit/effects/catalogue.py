"""The catalogue of effects: one tuple; third parties add theirs by the entry point ``femfit.effects``."""

from collections.abc import Iterable, Sequence
from functools import cache
from importlib.metadata import entry_points

from femfit.core.entry_catalogue import EntryCatalogue
from femfit.effects.coil_temperature import COIL_TEMPERATURE
from femfit.effects.core_remanence import CORE_REMANENCE
from femfit.effects.core_saturation import CORE_SATURATION
from femfit.effects.drawn_spring import SPRING_IN_FORCE, SPRING_PRELOAD, SPRING_STIFFNESS
from femfit.effects.driver_dead_zone import DRIVER_DEAD_ZONE
from femfit.effects.eddy_current_lag import EDDY_CURRENT_LAG
from femfit.effects.effect import Effect
from femfit.effects.external_field import EXTERNAL_FIELD
from femfit.effects.flux_integrator_drift import FLUX_INTEGRATOR_DRIFT
from femfit.effects.friction import COULOMB_FRICTION, FLUID_DRAG, VISCOUS_FRICTION
from femfit.effects.hall_coil_pickup import HALL_COIL_PICKUP
from femfit.effects.hall_element import HALL_DRIFT, HALL_SATURATION, HALL_TEMPERATURE
from femfit.effects.hysteresis import HYSTERESIS
from femfit.effects.lateral_misalignment import LATERAL_MISALIGNMENT
from femfit.effects.magnet import MAGNET_DEMAGNETISATION, MAGNET_TEMPERATURE
from femfit.effects.mechanical_force import CONSTANT_FORCE, END_STOP_CONTACT
from femfit.effects.motional_emf import MOTIONAL_EMF
from femfit.effects.of_circuits import OF_EACH, SEPARATOR, effects_of, of_circuit
from femfit.effects.position_dependent_inductance import POSITION_DEPENDENT_INDUCTANCE
from femfit.effects.position_sensor import POSITION_DELAY, POSITION_NONLINEARITY
from femfit.effects.sensor_delay import SENSOR_DELAY
from femfit.effects.side_pull_friction import SIDE_PULL_FRICTION
from femfit.effects.spring import SPRING
from femfit.effects.stop_position import STOP_POSITION
from femfit.effects.supply_sag import SUPPLY_SAG
from femfit.effects.tolerances import REMANENCE, RESISTANCE, TURNS
from femfit.effects.zeros_and_scales import (
    CURRENT_GAIN,
    CURRENT_OFFSET,
    DISTANCE_OFFSET,
    DISTANCE_SCALE,
    DRIVER_GAIN,
    FORCE_GAIN,
    FORCE_OFFSET,
    HALL_OFFSET,
    MASS_ERROR,
)

BUILT_IN: tuple[Effect, ...] = (
    DISTANCE_OFFSET,
    REMANENCE,
    TURNS,
    RESISTANCE,
    FORCE_OFFSET,
    FORCE_GAIN,
    CURRENT_OFFSET,
    CURRENT_GAIN,
    HALL_OFFSET,
    MASS_ERROR,
    DISTANCE_SCALE,
    SPRING_IN_FORCE,
    SPRING,
    SPRING_PRELOAD,
    SPRING_STIFFNESS,
    COIL_TEMPERATURE,
    MAGNET_TEMPERATURE,
    CORE_SATURATION,
    HYSTERESIS,
    CORE_REMANENCE,
    EDDY_CURRENT_LAG,
    LATERAL_MISALIGNMENT,
    COULOMB_FRICTION,
    STOP_POSITION,
    END_STOP_CONTACT,
    CONSTANT_FORCE,
    VISCOUS_FRICTION,
    FLUID_DRAG,
    SIDE_PULL_FRICTION,
    POSITION_DEPENDENT_INDUCTANCE,
    MAGNET_DEMAGNETISATION,
    DRIVER_GAIN,
    DRIVER_DEAD_ZONE,
    SUPPLY_SAG,
    POSITION_DELAY,
    POSITION_NONLINEARITY,
    SENSOR_DELAY,
    HALL_TEMPERATURE,
    HALL_COIL_PICKUP,
    HALL_DRIFT,
    HALL_SATURATION,
    FLUX_INTEGRATOR_DRIFT,
    EXTERNAL_FIELD,
    MOTIONAL_EMF,
)
"""The commonest cause first: where readings fit several equally well, that is the order in which they are named.

Conventional, from what workshops and benches get wrong: zeros and tolerances before scales, these before physics that a
drawing leaves out.
"""

_EARLIER_NAMES = {"base_magnet_strength": "remanence", "base_turns": "turns", "base_resistance": "resistance"}
"""As model files of earlier versions call them."""

GROUP = "femfit.effects"
"""Entry points of other packages' effects, each named as its effect."""

_CATALOGUE = EntryCatalogue(Effect, "Effect", BUILT_IN)


def all_effects() -> dict[str, Effect]:
    """Every effect by its name: those of femfit, then those of installed packages.

    A name of femfit's own cannot be taken by another package.

    Raises
    ------
    ModelFileError
        If an installed package's effect cannot be loaded.

    Examples
    --------
    >>> import femfit as ff
    >>> list(ff.list_effects())[:3]
    ['distance_offset', 'remanence', 'turns']
    """
    return _CATALOGUE.all(entry_points(group=GROUP))


def effect_by_name(name: str) -> Effect:
    """Look up an effect, or that of a circuit as ``turns:lower``; only the package that gives it is loaded."""
    kind, _, circuit = name.partition(SEPARATOR)
    if circuit and kind in OF_EACH:
        return _of_circuit(kind, circuit)
    return _CATALOGUE.find(_EARLIER_NAMES.get(name, name), lambda: entry_points(group=GROUP))


@cache
def _of_circuit(kind: str, circuit: str) -> Effect:
    return of_circuit(effect_by_name(kind), circuit)


def known_effect(name: str) -> Effect | None:
    """The effect of a name, of one circuit or of the device; None where there is none."""
    kind, _, circuit = name.partition(SEPARATOR)
    return _of_circuit(kind, circuit) if circuit and kind in OF_EACH else all_effects().get(name)


def device_effects(circuits: Sequence[str], drawn: Iterable[Effect] = ()) -> dict[str, Effect]:
    """The catalogue for a device of these circuits; of several, what they can have; then the drawing's numbers."""
    found = effects_of(all_effects(), circuits)
    own = {name: effect_by_name(name) if effect.of else effect for name, effect in found.items()}
    return own | {effect.name: effect for effect in drawn}
