"""MAT files of MATLAB and Octave: v4 to v7 by SciPy, v7.3, which is HDF5, by h5py.

HDF5 files: groups of data sets, compound data sets, units as attributes.

From nested names, such as structs and groups, to tables: the vectors of one length that stand together.

A struct of vectors is a table; a vector with its name or unit beside it is a column; an array of structs with one
number a field is a table with one row a struct; a matrix takes the names that a list beside it has.

A table by its name in a file that may hold several.

References
----------
The MathWorks, MAT-File Format (R2024a): attributes ``MATLAB_class`` and ``MATLAB_empty`` of v7.3 follow from its HDF5.
"""

import io
from collections import Counter
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from femfit.core.errors import TableError
from femfit.core.results import listing
from femfit.tables.header import with_unit
from femfit.tables.raw_table import RawTable, raw_table_of

_OWN = frozenset(("__header__", "__version__", "__globals__", "__function_workspace__"))


def mat_tree(content: bytes) -> tuple[dict[str, Any], str]:
    """Variables of a MAT file up to v7 by their names, and what in it cannot be read."""
    from scipy.io import loadmat  # noqa: PLC0415  in the child alone
    from scipy.io.matlab import MatlabFunction, MatlabOpaque  # noqa: PLC0415

    tree = loadmat(io.BytesIO(content), simplify_cells=True)  # type: ignore[arg-type]  # stubs know no open file
    tree = {name: value for name, value in tree.items() if name not in _OWN}
    objects = [name for name, value in tree.items() if isinstance(value, MatlabOpaque | MatlabFunction)]
    return {name: value for name, value in tree.items() if name not in objects}, _objects(objects)


def _objects(names: list[str]) -> str:
    if not names:
        return ""
    which = listing(name for name in names if name != "None")
    return (
        f"It holds objects that only MATLAB can read{f' ({which})' if which else ''}, such as a table T or a "
        "timeseries ts: save s = table2struct(T, 'ToScalar', true), or a struct of ts.Time and ts.Data, instead."
    )


def hdf5_tree(content: bytes) -> tuple[dict[str, Any], str]:
    """Arrays of an HDF5 file by their names, a dictionary a group; of a MAT file of v7.3 as SciPy has those of v7.

    A number or text stands there as itself, a struct array as a list. What cannot be read comes second.
    """
    import h5py  # noqa: PLC0415  in the child alone

    objects: list[str] = []
    with h5py.File(io.BytesIO(content)) as file:
        return _group(file, file, h5py, objects), _objects(objects)


def _group(group: Any, file: Any, h5py: Any, objects: list[str]) -> Any:
    """The nodes of a group by their names, or a list of them for each struct of a struct array."""
    tree: dict[str, Any] = {}
    references = 0
    for name, node in group.items():
        if "MATLAB_object_decode" in node.attrs:
            objects.append(name)
        elif isinstance(node, h5py.Group) and not name.startswith("#"):
            tree[name] = _group(node, file, h5py, objects)
        elif isinstance(node, h5py.Dataset) and node.shape is not None:
            unit = next((node.attrs[key] for key in node.attrs if key.casefold() in {"unit", "units"}), None)
            tree[with_unit(name, unit)] = _array(node, file, h5py)
            references += h5py.check_ref_dtype(node.dtype) is not None and "MATLAB_class" not in node.attrs
    if references and references == len(tree):
        columns = {name: np.ravel(values) for name, values in tree.items()}
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return tree


def _array(node: Any, file: Any, h5py: Any) -> Any:
    """A data set, of MATLAB turned as there: text, number or array; a cell array holds what it refers to."""
    kind = node.attrs.get("MATLAB_class")
    if node.attrs.get("MATLAB_empty", 0):
        return "" if kind == b"char" else np.zeros(0)
    if kind == b"char":
        return "".join(map(chr, np.ravel(node[()].T)))
    if h5py.check_ref_dtype(node.dtype) is not None:
        nodes = [file[reference] for reference in np.ravel(node[()].T)]
        read = [_group(n, file, h5py, []) if isinstance(n, h5py.Group) else _array(n, file, h5py) for n in nodes]
        if read and all(isinstance(value, Mapping) for value in read):
            return read
        cells = np.empty(len(read), dtype=object)
        cells[:] = read
        return cells
    values = np.asarray(node.asstr()[()] if h5py.check_string_dtype(node.dtype) else node[()])
    array = np.squeeze(values.T if kind is not None else values)
    return array.item() if array.ndim == 0 and array.dtype.names is None else array


Columns = Mapping[str, NDArray[Any]]


def table_of_columns(name: str, columns: Columns, source: str, kind: str) -> RawTable:
    """Return columns of one length as a table."""
    native = {header: np.asarray(column, column.dtype.newbyteorder("=")) for header, column in columns.items()}
    return raw_table_of(pd.DataFrame(native), source, kind, name)


def require_library(module: str, package: str, source: str) -> None:
    """Refuse a file where the optional library that its kind needs is not installed."""
    if find_spec(module) is None:
        raise TableError(
            f"To read {source}, femfit needs the package {package}, which is not installed. Install it with "
            "pip install 'femfit[files]', or export the table as CSV."
        )


Tree = Mapping[str, Any]
TOP = "/"
"""Name of the table that stands in no group."""

_NUMBERS = "iufbmM"  # Kinds of numpy's types that are numbers or moments
_VALUES = frozenset(("value", "values", "data", "samples", "signal"))
_NAMES, _UNITS = ("label", "name"), ("unit", "units")


def nested_tables(
    tree: Tree, source: str, kind: str, separator: str = ".", path: str = "", outer: Columns | None = None
) -> list[RawTable]:
    """Find the tables of a tree of names, whose leaves are arrays, texts and numbers.

    A vector that stands alone above groups, such as one common clock, belongs to each of their tables of its length.
    """
    vectors, below = _sorted(tree)
    lengths = Counter(len(vector) for vector in vectors.values())
    tables = []
    for length in lengths:
        columns = {name: vector for name, vector in vectors.items() if len(vector) == length}
        if all(column.dtype.kind not in _NUMBERS for column in columns.values()):
            continue  # a list of names
        beside = {name: vector for name, vector in (outer or {}).items() if len(vector) == length}
        name = (path or TOP) + (f" ({length} rows)" if len(lengths) > 1 else "")
        tables.append(table_of_columns(name, {**beside, **columns}, source, kind))
    around = {**(outer or {}), **(vectors if len(vectors) == 1 else {})}
    for name, branch in below.items():
        tables += nested_tables(branch, source, kind, separator, f"{path}{separator}{name}" if path else name, around)
    return tables


def _sorted(tree: Tree) -> tuple[dict[str, NDArray[Any]], dict[str, Tree]]:
    """The columns that stand directly under a name, and the branches below it."""
    vectors: dict[str, NDArray[Any]] = {}
    below: dict[str, Tree] = {}
    matrices: dict[str, NDArray[Any]] = {}
    for name, value in tree.items():
        structs = _structs(value)
        if structs is not None:
            _sort_structs(name, structs, vectors, below)
        elif isinstance(value, np.ndarray) and value.dtype.names:
            below[name] = {field: value[field].ravel() for field in value.dtype.names}
        elif _is_column(value):
            vectors[name] = value
        elif isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in _NUMBERS and value.size:
            matrices[name] = value
    below |= _of_matrices(matrices, vectors)
    return vectors, below


def _structs(value: object) -> list[Tree] | None:
    """The structs of a struct, or of an array or list of them; None for anything else."""
    if isinstance(value, Mapping):
        return [value]
    many = list(value) if isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object) else []
    return many if many and all(isinstance(struct, Mapping) for struct in many) else None


def _sort_structs(name: str, structs: list[Tree], vectors: dict[str, NDArray[Any]], below: dict[str, Tree]) -> None:
    numbered = [name] if len(structs) == 1 else [f"{name}({k + 1})" for k in range(len(structs))]
    signals = [_signal(path, struct) for path, struct in zip(numbered, structs, strict=True)]
    rows = [{key: value for key, value in struct.items() if np.ndim(value) == 0} for struct in structs]
    for path, struct, signal in zip(numbered, structs, signals, strict=True):
        if signal is not None:
            vectors[signal[0]] = signal[1]
        elif len(structs) > 1 and all(row.keys() == rows[0].keys() == struct.keys() for row in rows):
            below[name] = {key: np.array([row[key] for row in rows]) for key in rows[0]}
            return
        else:
            below[path] = struct


def _signal(name: str, struct: Tree) -> tuple[str, NDArray[Any]] | None:
    """A struct that is one column: its values beside its name or unit, as Simulink and dSPACE write it."""
    values = [value for key, value in struct.items() if key.casefold() in _VALUES and _is_column(value)]
    if len(values) != 1 or any(_is_column(field) for key, field in struct.items() if key.casefold() not in _VALUES):
        return None
    texts = {key.casefold(): value for key, value in struct.items() if isinstance(value, str) and value.strip()}
    unit = next((texts[key] for key in _UNITS if key in texts), None)
    return with_unit(next((texts[key] for key in _NAMES if key in texts), name), unit), values[0]


def _is_column(value: object) -> bool:
    if not isinstance(value, np.ndarray) or value.ndim != 1 or len(value) < 2:
        return False
    return value.dtype.kind in f"{_NUMBERS}US" or (
        value.dtype == object and all(isinstance(cell, str) for cell in value)
    )


def _of_matrices(matrices: Mapping[str, NDArray[Any]], vectors: Mapping[str, NDArray[Any]]) -> dict[str, Tree]:
    """The matrices as tables: named by a list of as many names beside them, or by number."""
    result: dict[str, Tree] = {}
    texts = [vector for vector in vectors.values() if vector.dtype.kind not in _NUMBERS]
    for name, matrix in matrices.items():
        names = next((names for names in texts if len(names) == matrix.shape[1]), None)
        numbered = [f"{name} column {k + 1}" for k in range(matrix.shape[1])]
        result[name] = dict(zip(numbered if names is None else map(str, names), matrix.T, strict=True))
    return result
