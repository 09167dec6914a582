"""What a record told of the noise that moves a device."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ProcessNoise:
    """What a record told of the noise that moves body and current; None for what it could not tell."""

    acceleration_density: float | None = None  # White acceleration, m^2/s^3
    voltage_V: float | None = None  # White from sample to sample
