"""How far a loop is from losing its stability, at the plant's input.

With the loop's gain L(z), broken where the commands enter the drivers, and S = (I + L)^-1:

- *gain margin*: factors on the commands, below and above one, at which the loop just oscillates;
- *phase margin*: lag at which it does, at a frequency where the gain is one;
- *delay margin*: that lag as a time, phase over frequency, where it is least;
- *modulus margin*: 1 / max |S|, the least distance of L from -1; with several commands the largest singular value of S.

With several commands gain, phase and delay margin hold for each command with the others closed, L_k = 1 / S_kk - 1; the
worst is stated.

All of them hold of commands that act otherwise than they are told. A loop whose gain is below one at every frequency,
the largest eigenvalue of L in magnitude, has no phase and no delay margin: a body that is stable by itself bears any
lag of what hardly acts. Such a loop goes by its model, and its sensors correct little of what the model does not know.

References
----------
S. Skogestad and I. Postlethwaite, Multivariable Feedback Control (Wiley, 2005), sections 2.4 and 9.6.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from femfit.core.numerics import ComplexArray, FloatArray
from femfit.simulation.constants import NOISE_ROOM, THIN_MODULUS, THIN_PHASE_DEG, WANTED_MODULUS, WANTED_PHASE_DEG
from femfit.simulation.linear_loop import LinearController, LinearPlant, closed_loop_matrix

FREQUENCIES, LOWEST, BELOW_SLOWEST, LEAST = 600, 1e-4, 0.1, 1e-9
"""Conventional: points of the frequency response, and the lowest over the Nyquist frequency; it is lower where the loop
moves more slowly, a tenth of the rate of its slowest pole, where the response has its value at rest to 1 %, and no
lower than rounding allows."""

ON_AXIS = 0.1
"""Derived: at an angle of less than this to the real axis an end of the response lies within 0.5 % of its value on the
axis. A loop with an integral leaves the axis towards low frequencies instead and does not cross it there."""


@dataclass(frozen=True)
class Margins:
    """Of one loop at one point of rest."""

    stable: bool
    gain_below: float  # Factor below one on the commands at which it oscillates; 0 where there is none
    gain_above: float  # Factor above one; infinite where there is none
    phase_rad: float
    delay_s: float
    modulus: float  # 0 where the loop is unstable
    # Of the loop over all frequencies, of all commands together; below one it hardly uses its sensors
    largest_gain: float
    slowest_pole_rad_s: float  # Rate at which the loop's slowest motion decays; negative where one grows
    # Rms of each command that the sensors' noise makes, over the way from the resting command to the nearer limit
    noise_share: float

    @property
    def kept(self) -> float:
        """Phase or modulus margin over the wanted one, whichever is less, cut where noise takes too much of the room.

        One where all that is wanted is kept. Steps of the reference use half of the room, and a loop at its limits is
        another loop, for which no margin makes up.
        """
        least = min(1.0, self.modulus / WANTED_MODULUS, np.degrees(self.phase_rad) / WANTED_PHASE_DEG)
        return float(least * min(1.0, NOISE_ROOM / max(self.noise_share, 1e-300)))

    @property
    def thin(self) -> bool:
        """Whether it is stable with less margin than is usual as the least."""
        return self.stable and (self.modulus < THIN_MODULUS or np.degrees(self.phase_rad) < THIN_PHASE_DEG)

    @property
    def uses_sensors(self) -> bool:
        """Whether its gain reaches one at some frequency, without which there is no phase margin."""
        return not self.largest_gain < 1.0


def worst_of(margins: Sequence[Margins]) -> Margins:
    """The least of each margin over the points of rest, and the largest gain of the loop at any of them.

    A number that one point has not is NaN.
    """
    numbers = np.array([astuple(point) for point in margins], dtype=np.float64)
    least, most = (Margins(*edge.tolist()) for edge in (numbers.min(axis=0), numbers.max(axis=0)))
    largest = {name: getattr(most, name) for name in ("gain_below", "largest_gain", "noise_share")}
    return replace(least, stable=bool(least.stable), **largest)


def margins(
    plant: LinearPlant,
    controller: LinearController,
    sample_time_s: float,
    room: FloatArray,
    points: int = FREQUENCIES,
) -> Margins:
    """Margins of a linear loop.

    Parameters
    ----------
    room : array, shape (n,)
        From the resting commands to the nearer limits, in the commands' units.
    points : int
        Of the frequency response.
    """
    largest = float(np.abs(np.linalg.eigvals(closed_loop_matrix(plant, controller))).max())
    slowest = float(-np.log(max(largest, 1e-300)) / sample_time_s)
    nyquist = np.pi / sample_time_s
    w = nyquist * np.geomspace(np.clip(BELOW_SLOWEST * abs(slowest) / nyquist, LEAST, LOWEST), 1.0, points)
    z = np.exp(1j * w * sample_time_s)
    K, G = controller.response(z), plant.response(z, controller.latency)
    minus_L = K @ G
    S = np.linalg.inv(np.eye(K.shape[1]) - minus_L)
    from_noise = (S @ K) * plant.noise
    power = np.sum(np.abs(from_noise) ** 2, axis=2)  # of each command, (frequencies, n)
    variance = np.trapezoid(power, w, axis=0) * sample_time_s / np.pi
    share = float(np.max(np.sqrt(variance) / np.maximum(room, 1e-12)))
    if not largest < 1.0:
        return Margins(False, np.nan, np.nan, 0.0, 0.0, 0.0, np.nan, slowest, share)
    modulus = 1.0 / float(np.linalg.norm(S, ord=2, axis=(1, 2)).max())
    largest_gain, of_commands = float(np.abs(np.linalg.eigvals(minus_L)).max()), []
    for sensitivity in np.diagonal(S, axis1=1, axis2=2).T:
        L = np.asarray(1.0 / sensitivity - 1.0, dtype=np.complex128)
        edges = *gain_margins(L), *phase_and_delay_margin(w, L)
        of_commands.append(Margins(True, *edges, modulus, largest_gain, slowest, share))
    return worst_of(of_commands)


def gain_margins(L: ComplexArray) -> tuple[float, float]:
    """The factors nearest to one, below and above it, that bring L to -1; 0 and infinity where there are none."""
    (real,) = _at_zeros(L.imag, L.real)
    ends = L[[0, -1]]
    ends = ends[np.abs(ends.imag) < ON_AXIS * np.abs(ends.real)]
    crossings = np.append(real, ends.real)
    factors = -1.0 / crossings[crossings < 0.0]
    return float(factors[factors < 1.0].max(initial=0.0)), float(factors[factors > 1.0].min(initial=np.inf))


def phase_and_delay_margin(w: FloatArray, L: ComplexArray) -> tuple[float, float]:
    """Least lag in rad, either way, at a gain of one, and least delay in s that makes such a lag."""
    frequency, phase = _at_zeros(np.log(np.abs(L)), w, np.unwrap(np.angle(L)))
    if not frequency.size:
        return np.pi, np.inf
    lag = np.mod(phase + np.pi, 2.0 * np.pi)  # 0 at -1
    return float(np.minimum(lag, 2.0 * np.pi - lag).min()), float((lag / frequency).min())


def _at_zeros(values: FloatArray, *others: FloatArray) -> list[FloatArray]:
    """Others, each (n,), where values (n,) change their sign, all linear from point to point."""
    turns = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    share = values[turns] / (values[turns] - values[turns + 1])
    return [other[turns] + share * (other[turns + 1] - other[turns]) for other in others]
