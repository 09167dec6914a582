"""Effects that a record of a moving body shows: each changes the body, its driver or its sensor by a given size."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from support.trial_study.levitated_body import Body


@dataclass(frozen=True)
class MovingEffect:
    """One effect up to its size.

    Parameters
    ----------
    typical, limit : float
        Usual size, and the largest that is still believable, in ``unit``.
    change : callable
        (body, size, generator) -> body; the generator draws what else the effect has.
    channels : tuple of str
        Balances or channels of the diagnosis in which it shows.
    along : tuple of str
        Columns with which its misfit changes by its physics.
    """

    typical: float
    limit: float
    unit: str
    change: Callable[[Body, float, np.random.Generator], Body]
    channels: tuple[str, ...]
    along: tuple[str, ...] = ()


def _eddies(body: Body, size: float, generator: np.random.Generator) -> Body:
    slow = float(generator.uniform(1.5e-3, 6e-3))
    fast = slow * float(generator.uniform(0.08, 0.2))
    second = float(generator.uniform(0.2, 0.5))
    return replace(body, eddy_shares=(size / (1.0 + second), size * second / (1.0 + second)), eddy_times_s=(slow, fast))


def _stiction(body: Body, size: float, generator: np.random.Generator) -> Body:
    return replace(
        body,
        coulomb_N=size,
        breakaway=float(generator.uniform(1.1, 1.6)),
        stribeck_m_s=float(generator.uniform(2e-3, 1e-2)),
    )


def _drag(body: Body, size: float, generator: np.random.Generator) -> Body:
    return replace(body, viscous_N_s_m=size, braking=float(generator.uniform(0.0, 1.0)))


def _sign(generator: np.random.Generator) -> float:
    return float(generator.choice([-1.0, 1.0]))


_FORCE, _VOLTAGE, _HALL = "force_balance_N", "voltage_balance_V", "hall_V"

SERIES_EFFECTS: Mapping[str, MovingEffect] = {
    "motional_emf": MovingEffect(
        0.3, 2.0, "", lambda b, s, g: replace(b, leads=_sign(g) * s), (_VOLTAGE,), ("velocity_m_s",)
    ),
    "viscous_friction": MovingEffect(0.02, 0.3, "N s/m", _drag, (_FORCE,), ("velocity_m_s",)),
    "coulomb_friction": MovingEffect(2e-3, 8e-3, "N", _stiction, (_FORCE,), ("velocity_m_s",)),
    "mass_error": MovingEffect(
        0.02, 0.1, "", lambda b, s, g: replace(b, mass_kg=b.mass_kg * (1.0 + _sign(g) * s)), (_FORCE,)
    ),
    "sensor_delay": MovingEffect(
        5e-4,
        2e-3,
        "s",
        lambda b, s, g: replace(b, delay_s=s),
        (_HALL,),
        ("velocity_m_s", "current_rate_A_s"),
    ),
    "eddy_current_lag": MovingEffect(0.15, 0.6, "", _eddies, (_VOLTAGE, _FORCE, _HALL), ("current_rate_A_s",)),
    "driver_gain": MovingEffect(
        0.03, 0.15, "", lambda b, s, g: replace(b, driver_gain=_sign(g) * s), (_VOLTAGE,), ("voltage_V", "current_A")
    ),
    "driver_dead_zone": MovingEffect(0.1, 0.5, "V", lambda b, s, g: replace(b, dead_zone_V=s), (_VOLTAGE,)),
    "coil_temperature": MovingEffect(
        10.0,
        80.0,
        "K",
        lambda b, s, g: replace(b, warming_K=s),
        (_VOLTAGE,),
        ("current_A", "time_s", "order", "elapsed"),
    ),
    "constant_force": MovingEffect(1e-3, 5e-3, "N", lambda b, s, g: replace(b, pull_N=_sign(g) * s), (_FORCE,)),
    "hall_offset": MovingEffect(0.01, 0.1, "V", lambda b, s, g: replace(b, hall_offset_V=_sign(g) * s), (_HALL,)),
}
"""By name, as the trial's list calls them."""
