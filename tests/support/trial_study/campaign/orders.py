"""Which cases a trial holds: how many without, with one and with two effects, at which size, on which actuator."""

from collections.abc import Mapping, Sequence

import numpy as np

from femfit.trial.virtual_bench import LEVELS
from support.trial_study.campaign.case import Order
from support.trial_study.truth.bench_effects import twins_of

SHARES = {0: 0.3, 1: 0.45, 2: 0.25}
"""Part of the cases with so many effects."""


def draw_orders(possible: Mapping[str, Sequence[str]], cases: int, seed: int) -> list[Order]:
    """Draw a trial's cases.

    Returns
    -------
    list of Order
        Single effects go round the list so that each comes equally often; every prefix of it has about the same shares.
    """
    generator = np.random.default_rng(seed)
    names = list(possible)
    every = [name for actuator in names for name in possible[actuator]]
    rounds: list[str] = []
    result = []
    for number in range(1, cases + 1):
        count = int(_turn(number))
        actuator = names[int(generator.integers(len(names)))]
        effects: tuple[str, ...] = ()
        if count == 1:
            if not rounds:
                rounds = list(generator.permutation(sorted(set(every))))
            name = str(rounds.pop())
            actuator = str(generator.choice([a for a in names if name in possible[a]]))
            effects = (name,)
        elif count == 2:
            first = str(generator.choice(possible[actuator]))
            others = [name for name in possible[actuator] if name not in twins_of(first)]  # two twins are one effect
            effects = (first, str(generator.choice(others)))
        level = float(generator.choice(LEVELS)) if count else 0.0
        result.append(Order(number, actuator, effects, level, seed))
    return result


def _turn(number: int) -> int:
    """How many effects the case of a number has: twenty turns hold the shares exactly."""
    turns = np.concatenate([np.full(round(20 * share), count) for count, share in SHARES.items()])
    return int(turns[(number * 7) % len(turns)])
