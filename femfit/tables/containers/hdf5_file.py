"""HDF5 files: groups of data sets, compound data sets, units as attributes."""

import io
from typing import Any

import numpy as np

from femfit.tables.containers.named_table import NamedTable, library
from femfit.tables.containers.nested import nested_tables, with_unit


def read_hdf5(content: bytes, source: str) -> tuple[list[NamedTable], str]:
    """Tables of an HDF5 file."""
    h5py = library("h5py", "h5py", source)
    with h5py.File(io.BytesIO(content)) as file:
        return nested_tables(_tree(file, h5py), source, "HDF5", separator="/"), ""


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
