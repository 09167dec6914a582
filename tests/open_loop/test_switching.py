"""Which ways to a stop are pull-in and drop-out: those that begin at rest on the other one."""

import numpy as np
import pytest

from femfit.simulation.events import Event
from femfit.simulation.profile import Profile
from femfit.simulation.switching import switchings

STEP = (Profile("voltage", np.array([0.0]), np.array([12.0])),)


def kinds(*names, begun_at="far"):
    events = [Event(1e-3 * k, name, 1e-3, 0.3, 0.5) for k, name in enumerate(names, start=1)]
    return [one.kind for one in switchings(events, begun_at, STEP)]


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("starts", "hits_near", "hits_near", "rests_near", "starts", "hits_far"), ["pull_in", "drop_out"]),
        # thrown from stop to stop, as a vibration motor is
        (("starts", "hits_near", "hits_far", "hits_near"), ["pull_in", "to_far", "to_near"]),
        # a stop that gives way has no rest
        (("starts", "hits_near", "leaves_near", "hits_far"), ["pull_in", "drop_out"]),
        # an event that is no contact changes nothing
        (("starts", "hits_near", "current_leaves_domain", "hits_far"), ["pull_in", "to_far"]),
    ],
)
def test_a_body_switches_where_it_rested_on_the_stop_that_it_leaves(names, found):
    assert kinds(*names) == found


def test_a_body_that_begins_in_the_air_reaches_a_stop():
    assert kinds("starts", "hits_far", begun_at=None) == ["to_far"]
