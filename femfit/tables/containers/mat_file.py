"""MAT files of MATLAB and Octave: v4 to v7 by SciPy, v7.3, which is HDF5, by h5py.

References
----------
The MathWorks, MAT-File Format (R2024a): attributes ``MATLAB_class`` and ``MATLAB_empty`` of v7.3 follow from its HDF5.
"""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from femfit.core.finding import listing

_OWN = frozenset(("__header__", "__version__", "__globals__", "__function_workspace__"))


def mat_tree(content: bytes) -> tuple[dict[str, Any], str]:
    """Variables of a MAT file up to v7 by their names, and what in it cannot be read."""
    from scipy.io import loadmat  # noqa: PLC0415  in the child alone
    from scipy.io.matlab import MatlabFunction, MatlabOpaque  # noqa: PLC0415

    tree = loadmat(io.BytesIO(content), simplify_cells=True)  # type: ignore[arg-type]  # stubs know no open file
    tree = {name: value for name, value in tree.items() if name not in _OWN}
    objects = [name for name, value in tree.items() if isinstance(value, MatlabOpaque | MatlabFunction)]
    return {name: value for name, value in tree.items() if name not in objects}, _objects(objects)


def mat73_tree(content: bytes) -> tuple[dict[str, Any], str]:
    """Variables of a MAT file of v7.3 by their names, and what in it cannot be read."""
    import h5py  # noqa: PLC0415

    objects: list[str] = []
    with h5py.File(io.BytesIO(content)) as file:
        tree: dict[str, Any] = {}
        for name, node in file.items():
            if name.startswith("#"):
                continue
            if "MATLAB_object_decode" in node.attrs:
                objects.append(name)
            else:
                tree[name] = _value(node, file, h5py)
    return tree, _objects(objects)


def _objects(names: list[str]) -> str:
    if not names:
        return ""
    which = listing(name for name in names if name != "None")
    return (
        f"It holds objects that only MATLAB can read{f' ({which})' if which else ''}, such as a table T or a "
        "timeseries ts: save s = table2struct(T, 'ToScalar', true), or a struct of ts.Time and ts.Data, instead."
    )


def _value(node: Any, file: Any, h5py: Any) -> Any:
    """A node of a v7.3 file as SciPy simplifies one of v7: dict, list of dict, text, number or array."""
    if isinstance(node, h5py.Group):
        fields = {name: _value(child, file, h5py) for name, child in node.items()}
        lists = [node[name] for name in fields if isinstance(node[name], h5py.Dataset) and _is_cell(node[name], h5py)]
        arrays = [cells for cells in lists if "MATLAB_class" not in cells.attrs]
        if fields and len(arrays) == len(fields):  # a struct array: one list of references a field
            count = len(np.ravel(arrays[0]))
            return [{name: np.ravel(value)[k] for name, value in fields.items()} for k in range(count)]
        return fields
    kind = node.attrs.get("MATLAB_class", b"")
    if node.attrs.get("MATLAB_empty", 0):
        return "" if kind == b"char" else np.zeros(0)
    if kind == b"char":
        return "".join(map(chr, np.ravel(node[()].T)))
    if _is_cell(node, h5py):
        return _cells(
            [_value(file[reference], file, h5py) for reference in np.ravel(node[()].T, order="C")], node.shape
        )
    values = node.asstr()[()] if h5py.check_string_dtype(node.dtype) else node[()]
    array = np.squeeze(np.asarray(values).T)
    return array.item() if array.ndim == 0 else array


def _is_cell(node: Any, h5py: Any) -> bool:
    return h5py.check_ref_dtype(node.dtype) is not None


def _cells(values: list[Any], shape: tuple[int, ...]) -> Any:
    """A cell array, without the dimensions of one element; lists of structs stay lists."""
    if values and all(isinstance(value, Mapping) for value in values):
        return values
    cells = np.empty(len(values), dtype=object)
    cells[:] = values
    return np.squeeze(cells.reshape(tuple(reversed(shape)))) if len(values) > 1 else cells
