"""HDF5 files: groups of data sets, compound data sets, units as attributes."""

import io
from typing import Any

import numpy as np

from femfit.tables.header import with_unit


def hdf5_tree(content: bytes) -> tuple[dict[str, Any], str]:
    """Arrays of an HDF5 file by their names, a dictionary a group."""
    import h5py  # noqa: PLC0415  in the child alone

    with h5py.File(io.BytesIO(content)) as file:
        return _tree(file, h5py), ""


def _tree(group: Any, h5py: Any) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for name, node in group.items():
        if isinstance(node, h5py.Group):
            tree[name] = _tree(node, h5py)
            continue
        if not isinstance(node, h5py.Dataset) or node.shape is None or h5py.check_ref_dtype(node.dtype) is not None:
            continue
        unit = next((node.attrs[key] for key in node.attrs if key.casefold() in {"unit", "units"}), None)
        values = node.asstr()[()] if h5py.check_string_dtype(node.dtype) else node[()]
        array = np.asarray(values)
        tree[with_unit(name, unit)] = np.squeeze(array) if array.ndim else values
    return tree
