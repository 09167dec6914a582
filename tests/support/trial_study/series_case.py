"""One case of recorded motion: a levitated body with no, one or two hidden effects, and what was recorded of it."""

from dataclasses import asdict

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError
from femfit.model.actuator_model import ActuatorModel
from support.trial_study.campaign.case import Case, Order
from support.trial_study.levitated_body import Body, MovingTruth
from support.trial_study.record import Recorder, Trajectory, closed_loop, record, window_change
from support.trial_study.series_effects import SERIES_EFFECTS
from support.trial_study.truth.families import Truth

_TRIES = 12
_SIZING_SAMPLES = 800


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # a body that runs away is drawn anew
def make_series_case(truth: Truth, model: ActuatorModel, order: Order, sized: Trajectory) -> Case:
    """Record a case.

    Parameters
    ----------
    model : ActuatorModel
        Of the drawing: what the loop was designed with.

    Returns
    -------
    Case
        The same for the same order; rows are a time series.

    Raises
    ------
    DomainError
        If no record was found in which the body was held with effects of the level within their limits.
    """
    generator = np.random.default_rng([order.seed, order.number])
    plain = Body(truth.actuator.mechanics.mass_kg)
    for _ in range(_TRIES):
        recorder = _drawn_recorder(model, order, generator)
        seeds = [int(generator.integers(2**31)) for _ in order.effects]
        sizes = [
            _size(truth, model, plain, (name, seed), order.level, (sized, recorder))
            for name, seed in zip(order.effects, seeds, strict=True)
        ]
        if not np.isfinite(sizes).all():
            continue
        body = plain
        for name, size, seed in zip(order.effects, sizes, seeds, strict=True):
            body = SERIES_EFFECTS[name].change(body, size, np.random.default_rng(seed))
        try:
            trajectory = closed_loop(MovingTruth(truth, body), model, recorder, generator)
        except DomainError:
            continue
        rows = record(trajectory, model, recorder, generator)
        kept = rows["run"] == recorder.runs
        declared = {name: float(f"{s:.3g}") for name, s in recorder.sigma.items()} if generator.random() < 0.5 else {}
        key = {
            "order": asdict(order),
            "all_channels": "hall_V" in recorder.sigma,
            "effects": [
                {
                    "name": name,
                    "size": size,
                    "unit": SERIES_EFFECTS[name].unit,
                    "over_noise": _over_noise(truth, model, plain, (name, seed), size, (sized, recorder)),
                    "channels": list(SERIES_EFFECTS[name].channels),
                    "along": list(SERIES_EFFECTS[name].along),
                    "twins": [name],
                }
                for name, size, seed in zip(order.effects, sizes, seeds, strict=True)
            ],
            "body": asdict(body),
            "recorder": {**asdict(recorder), "sigma": dict(recorder.sigma)},
            "unseen_floor": {},
        }
        unseen, seen = (rows[part].reset_index(drop=True) for part in (kept, ~kept))
        return Case(order, seen, unseen, declared, key)
    raise DomainError(
        f"Case {order.number} must hold the body with {' and '.join(order.effects)} of {order.level:g} noise sigmas; "
        "no record did. Leave the effect out."
    )


def sizing_record(truth: Truth, model: ActuatorModel) -> Trajectory:
    """A record of the body as drawn, from which the windows start that size the effects of all cases."""
    recorder = Recorder(2, _SIZING_SAMPLES, {}, _targets(model))
    body = Body(truth.actuator.mechanics.mass_kg)
    return closed_loop(MovingTruth(truth, body), model, recorder, np.random.default_rng(0))


def _targets(model: ActuatorModel) -> tuple[float, ...]:
    low, high = min(model.reference_distances_m), max(model.reference_distances_m)
    return tuple(low + share * (high - low) for share in (0.0, 0.5, 0.1, 0.75, 0.3, 0.9, 0.2))


def _drawn_recorder(model: ActuatorModel, order: Order, generator: np.random.Generator) -> Recorder:
    sigma = {
        "distance_m": float(np.exp(generator.uniform(np.log(5e-6), np.log(3e-5)))),
        "current_A": float(np.exp(generator.uniform(np.log(1e-3), np.log(4e-3)))),
    }
    needed = any(SERIES_EFFECTS[name].channels == ("hall_V",) for name in order.effects)
    if generator.random() < 0.7 or needed:
        sigma["hall_V"] = float(generator.uniform(1.5e-3, 4e-3))
    targets = _targets(model)
    start = int(generator.integers(3))
    return Recorder(
        runs=int(generator.integers(3, 5)),
        samples=int(generator.integers(1200, 2500)),
        sigma=sigma,
        targets_m=targets[start : start + int(generator.integers(2, 5))],
    )


def _over_noise(
    truth: Truth,
    model: ActuatorModel,
    plain: Body,
    effect: tuple[str, int],
    size: float,
    sized: tuple[Trajectory, Recorder],
) -> dict[str, float]:
    """Rms of an effect over the noise within windows of 20 ms, per recorded channel."""
    name, seed = effect
    trajectory, recorder = sized
    body = SERIES_EFFECTS[name].change(plain, size, np.random.default_rng(seed))
    change = window_change(MovingTruth(truth, plain), MovingTruth(truth, body), trajectory, model.sample_time_s)
    return {channel: _rms(change[channel]) / sigma for channel, sigma in recorder.sigma.items()}


def _size(
    truth: Truth,
    model: ActuatorModel,
    plain: Body,
    effect: tuple[str, int],
    level: float,
    sized: tuple[Trajectory, Recorder],
) -> float:
    """The size at which the most affected channel shows an effect by ``level`` sigmas; NaN beyond its limit."""
    entry = SERIES_EFFECTS[effect[0]]
    size = entry.typical
    for _ in range(4):  # in proportion, or nearly
        seen = max(_over_noise(truth, model, plain, effect, size, sized).values())
        if abs(seen - level) < 0.03 * level:
            break
        size = min(size * level / max(seen, 1e-12), 2.0 * entry.limit)
    return size if size <= entry.limit else float("nan")


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
