"""The error tree: each of ours is also a builtin, and survives the way back from a worker process."""

import pickle

import pytest

from femfit.core import errors


def tree():
    return [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, errors.FemfitError)]


@pytest.mark.parametrize("kind", [kind for kind in tree() if kind is not errors.FemfitError], ids=lambda k: k.__name__)
def test_each_error_is_also_a_builtin(kind):
    builtins = {base for base in kind.__mro__ if base.__module__ == "builtins"}
    assert len(builtins - {object, BaseException, Exception}) >= 1
    assert kind.__name__ in errors.__doc__


def test_an_actuator_error_keeps_its_problems_through_a_pickle():
    error = errors.ActuatorFileError("a.toml", ["coil.turns: 0", "moving: empty"])
    again = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own bytes
    assert again.problems == error.problems
    assert str(again) == str(error)
    assert "2 problems" in str(error)
