"""Consecutive blocks of an integrated field as one."""

from dataclasses import fields

import numpy as np

from femfit.integrate.uncertainty import FieldBlock, Responses


def joined(blocks):
    def whole(items, kind):
        names = [one.name for one in fields(kind) if one.name != "responses"]
        return {name: np.concatenate([getattr(item, name) for item in items]) for name in names}

    responses = Responses(**whole([block.responses for block in blocks], Responses))
    return FieldBlock(**whole(blocks, FieldBlock), responses=responses)


def run(integrator, record, cuts=()):
    """The field of a record, handed over in pieces."""
    state, blocks = integrator.start(), []
    for begin, end in zip([0, *cuts], [*cuts, len(record)], strict=True):
        state, block = integrator.advance(state, record[begin:end])
        blocks.append(block)
    return joined(blocks)
