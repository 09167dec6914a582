"""What is hidden in a campaign, and which names of the catalogue would be right; none where it has nothing like it."""

from dataclasses import dataclass

CLEAN = "nothing"


@dataclass(frozen=True)
class Cause:
    """One cause on one device.

    Parameters
    ----------
    names : tuple of str
        Effects of the catalogue that say the same; empty for a cause that it does not have, where the right answer is
        that nothing explains the readings, or that a name is not certain.
    """

    device: str
    kind: str  # ``bench`` or ``record``
    name: str
    names: tuple[str, ...] = ()


BENCH = (
    Cause("solenoid", "bench", "shorted_turns", ("turns",)),
    Cause("solenoid", "bench", "short_pole", ("distance_offset",)),
    Cause("solenoid", "bench", "kept_flux", ("core_remanence",)),
    Cause("solenoid", "bench", "carried_spring", ("spring_in_force",)),
    Cause("solenoid", "bench", "other_steel"),
    Cause("solenoid", "bench", "back_gap"),
    Cause("solenoid", "bench", "worn_bore"),
    Cause("solenoid", "bench", "bent_load_cell"),
    Cause("solenoid", "bench", "bent_stage"),
    Cause("voice-coil", "bench", "shorted_turns", ("turns",)),
    Cause("voice-coil", "bench", "coil_moved", ("distance_offset",)),
    Cause("voice-coil", "bench", "weak_magnet", ("remanence",)),
    Cause("voice-coil", "bench", "weak_layer", ("remanence", "magnet_demagnetisation")),
    Cause("voice-coil", "bench", "wide_gap"),
    Cause("voice-coil", "bench", "bent_load_cell"),
    Cause("voice-coil", "bench", "bent_stage"),
)

RECORDS = (
    Cause("solenoid", "record", "stiffer_spring", ("spring_stiffness",)),
    Cause("solenoid", "record", "bent_position", ("position_nonlinearity",)),
    Cause("solenoid", "record", "weak_supply", ("supply_sag",)),
    Cause("solenoid", "record", "worn_stop", ("stop_position",)),
    Cause("solenoid", "record", "kinked_spring"),
    Cause("solenoid", "record", "side_pull"),
    Cause("voice-coil", "record", "stiffer_spring", ("spring_stiffness",)),
    Cause("voice-coil", "record", "bent_position", ("position_nonlinearity",)),
    Cause("voice-coil", "record", "weak_supply", ("supply_sag",)),
    Cause("voice-coil", "record", "more_damping", ("viscous_friction",)),
    Cause("voice-coil", "record", "heavier", ("mass_error",)),
    Cause("voice-coil", "record", "hardening_spring"),
)
