"""MAT and HDF5 files, decoded in a process of their own.

A damaged one can make their libraries in C crash, hang, or fill the memory with what it says that it holds.
"""

from collections.abc import Callable
from typing import Any

from femfit.core.child import ChildError, in_child
from femfit.core.errors import TableError
from femfit.tables.containers.hdf5_file import hdf5_tree
from femfit.tables.containers.mat_file import mat73_tree, mat_tree
from femfit.tables.containers.named_table import NamedTable, require_library
from femfit.tables.containers.nested import nested_tables
from femfit.tables.decoding import damaged

TIMEOUT_S, TIMEOUT_S_PER_BYTE = 30.0, 1e-6
"""Chosen: a file of 1 MB takes 0.3 s on a free machine, most of it the libraries' import, and 100 MB take 1 s."""

MEMORY, MEMORY_PER_BYTE = 2e9, 64.0
"""Bytes, chosen: what numbers unpack to, several times over, beside the libraries'."""

_DECODERS: dict[str, Callable[[bytes], tuple[dict[str, Any], str]]] = {
    "MAT": mat_tree,
    "MAT 7.3": mat73_tree,
    "HDF5": hdf5_tree,
}


def read_apart(kind: str, content: bytes, source: str) -> tuple[list[NamedTable], str]:
    """Tables of a MAT or HDF5 file, and what in it cannot be read."""
    if kind != "MAT":
        require_library("h5py", "h5py", source)
    timeout, memory = TIMEOUT_S + TIMEOUT_S_PER_BYTE * len(content), MEMORY + MEMORY_PER_BYTE * len(content)
    try:
        tree, remark = in_child(_DECODERS[kind], content, timeout=timeout, memory=memory)
    except MemoryError as error:
        raise TableError(
            f"{source} says that it unpacks to more memory than its {len(content) / 1e6:.3g} MB may take "
            f"({error}). Unless it is damaged, raise this shell's limit (ulimit -v), or export fewer columns."
        ) from error
    except ChildError as error:
        raise TableError(damaged(source, kind, error)) from error
    return nested_tables(tree, source, kind, separator="/" if kind == "HDF5" else "."), remark
