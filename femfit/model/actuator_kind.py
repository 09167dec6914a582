"""What an actuator's drawing is made of, as far as effects and reports depend on it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ActuatorKind:
    """Which parts of the drawing are magnets, iron and winding."""

    fixed_magnet: bool
    moving_magnet: bool
    fixed_iron: bool
    moving_iron: bool
    coil: bool
    saturates: bool  # Whether a part's material has a B-H curve

    @property
    def has_magnet(self) -> bool:
        """Whether any part has a remanence."""
        return self.fixed_magnet or self.moving_magnet
