"""A winding and what feeds it: a bridge, a one-sided driver with a freewheel diode, or a current amplifier."""

from dataclasses import dataclass
from dataclasses import field as limited
from math import inf
from typing import Literal

# Limits in a field's metadata are what a model file is held to: see femfit.model.json_section.


@dataclass(frozen=True)
class Drive:
    """How a command becomes voltage or current; the limits of the voltage are those of the circuit.

    A voltage source gives what is commanded, within its limits. With a freewheel diode it is one-sided: it gives
    positive voltages alone, and without one the current goes on through the diode until it is zero.
    """

    kind: Literal["voltage", "current"] = "voltage"
    # Forward drop of the freewheel diode in V, with that of a Zener diode in series; None for a bridge
    diode_V: float | None = limited(default=None, metadata={"lower": 0.0})
    # Of a current amplifier; without limits it follows every command, without a bandwidth as fast as its voltage allows
    current_min_A: float | None = None
    current_max_A: float | None = None
    bandwidth_Hz: float | None = limited(default=None, metadata={"positive": True})


@dataclass(frozen=True)
class Circuit:
    """Coils in series and their driver: U = R i + L_s i' + d(flux linkage)/dt."""

    # Of all coils and what is in series with them
    resistance_ohm: float = limited(metadata={"positive": True})
    # Of the supply; a drawing without one leaves them open behind a current amplifier, a model has both
    voltage_min_V: float = -inf
    voltage_max_V: float = limited(default=inf, metadata={"not_below": "voltage_min_V"})
    drive: Drive = Drive()  # A bridge: voltages of both signs, as far as the limits go
    name: str = "coil"
    # L_s, in series, outside of the field
    inductance_H: float = limited(default=0.0, metadata={"lower": 0.0, "absent": 0.0})
