"""Models of which a part is changed."""

from dataclasses import replace


def with_circuit(model, **changes):
    """Of one circuit."""
    return replace(model, circuits=(replace(model.circuit, **changes),))


def with_motion(model, **changes):
    """With other mechanics."""
    return replace(model, motion=replace(model.motion, **changes))


def with_sensor(model, **changes):
    """With another Hall element."""
    return replace(model, sensor=replace(model.sensor, **changes))


def free(model):
    """Without stops."""
    return with_motion(model, near_stop=None, far_stop=None)
