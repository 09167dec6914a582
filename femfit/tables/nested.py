"""MAT files of MATLAB and Octave: v4 to v7 by SciPy, v7.3, which is HDF5, by h5py.

HDF5 files: groups of data sets, compound data sets, units as attributes.

From nested names, such as structs and groups, to tables: the vectors of one length that stand together.

A struct of vectors is a table; a vector with its name or unit beside it is a column; an array of structs with one
number a field is a table with one row a struct; a matrix takes the names that a list beside it has.

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

from femfit.core.results import listing
from femfit.tables.findings import refused
from femfit.tables.header import with_unit
from femfit.tables.raw_table import RawTable, typed_table

_OWN = frozenset(("__header__", "__version__", "__globals__", "__function_workspace__"))
_PROPRIETARY = (
    "It holds objects that only MATLAB can read{}, such as a table T or a timeseries ts: save "
    "s = table2struct(T, 'ToScalar', true), or a struct of ts.Time and ts.Data, instead."
)


def mat_tree(content: bytes) -> tuple[dict[str, Any], str]:
    """Variables of a MAT file up to v7 by their names, and what in it cannot be read."""
    from scipy.io import loadmat  # noqa: PLC0415  in the child alone
    from scipy.io.matlab import MatlabFunction, MatlabOpaque  # noqa: PLC0415

    tree = loadmat(io.BytesIO(content), simplify_cells=True)  # type: ignore[arg-type]  # stubs know no open file
    tree = {name: value for name, value in tree.items() if name not in _OWN}
    objects = [name for name, value in tree.items() if isinstance(value, MatlabOpaque | MatlabFunction)]
    return {name: value for name, value in tree.items() if name not in objects}, _objects(objects)


def hdf5_tree(content: bytes) -> tuple[dict[str, Any], str]:
    """Arrays of an HDF5 file by their names, a dictionary a group; of a MAT file of v7.3 as SciPy has those of v7.

    A number or text stands there as itself, a struct array as a list. What cannot be read comes second.
    """
    import h5py  # noqa: PLC0415  in the child alone

    objects: list[str] = []
    with h5py.File(io.BytesIO(content)) as file:
        return _group(file, objects), _objects(objects)


def _objects(names: list[str]) -> str:
    which = listing(name for name in names if name != "None")
    return _PROPRIETARY.format(f" ({which})" if which else "") if names else ""


def _group(group: Any, objects: list[str]) -> Any:
    """The nodes of a group by their names, or a list of them for each struct of a struct array."""
    import h5py  # noqa: PLC0415  in the child alone

    tree: dict[str, Any] = {}
    references = 0
    for name, node in group.items():
        if "MATLAB_object_decode" in node.attrs:
            objects.append(name)
        elif isinstance(node, h5py.Group) and not name.startswith("#"):
            tree[name] = _group(node, objects)
        elif isinstance(node, h5py.Dataset) and node.shape is not None:
            unit = next((node.attrs[key] for key in node.attrs if key.casefold() in {"unit", "units"}), None)
            tree[with_unit(name, unit)] = _array(node)
            references += h5py.check_ref_dtype(node.dtype) is not None and "MATLAB_class" not in node.attrs
    if references and references == len(tree):
        columns = {name: np.ravel(values) for name, values in tree.items()}
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return tree


def _array(node: Any) -> Any:
    """A data set, of MATLAB turned as there: text, number or array; a cell array holds what it refers to."""
    import h5py  # noqa: PLC0415  in the child alone

    kind = node.attrs.get("MATLAB_class")
    if node.attrs.get("MATLAB_empty", 0):
        return "" if kind == b"char" else np.zeros(0)
    if kind == b"char":
        return "".join(map(chr, np.ravel(node[()].T)))
    if h5py.check_ref_dtype(node.dtype) is not None:
        nodes = [node.file[reference] for reference in np.ravel(node[()].T)]
        read = [_group(cell, []) if isinstance(cell, h5py.Group) else _array(cell) for cell in nodes]
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
    return typed_table(pd.DataFrame(native), source, kind, name)


def require_library(module: str, package: str, source: str) -> None:
    """Refuse a file where the optional library that its kind needs is not installed."""
    if find_spec(module) is None:
        raise refused("no-library", source=source, package=package)


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
    entries = [entry for name, value in tree.items() for entry in _entries(name, value)]
    vectors = {name: value for name, value in entries if isinstance(value, np.ndarray) and value.ndim == 1}
    below = {name: value for name, value in entries if isinstance(value, Mapping)}
    texts = [vector for vector in vectors.values() if vector.dtype.kind not in _NUMBERS]
    for name, value in entries:
        if isinstance(value, np.ndarray) and value.ndim == 2:  # named by a list of as many names, or by number
            names = next((names for names in texts if len(names) == value.shape[1]), None)
            numbered = [f"{name} column {k + 1}" for k in range(value.shape[1])]
            below[name] = dict(zip(numbered if names is None else map(str, names), value.T, strict=True))
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


def _entries(name: str, value: Any) -> list[tuple[str, Any]]:
    """What stands under a name: columns, matrices, and branches such as each struct of an array of them."""
    if isinstance(value, np.ndarray) and value.dtype.names:
        return [(name, {field: value[field].ravel() for field in value.dtype.names})]
    if _is_column(value) or (isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in _NUMBERS):
        return [(name, value)] if value.size else []
    structs = [value] if isinstance(value, Mapping) else value
    several = isinstance(structs, list | np.ndarray) and np.ndim(structs) > 0
    if not several or not all(isinstance(struct, Mapping) for struct in structs):
        return []
    numbers = all(np.ndim(cell) == 0 for struct in structs for cell in struct.values())
    if len(structs) > 1 and numbers and all(struct.keys() == structs[0].keys() for struct in structs):
        return [(name, {key: np.array([struct[key] for struct in structs]) for key in structs[0]})]
    named = [(name if len(structs) == 1 else f"{name}({k + 1})", struct) for k, struct in enumerate(structs)]
    return [_signal(*entry) or entry for entry in named]


def _signal(name: str, struct: Tree) -> tuple[str, NDArray[Any]] | None:
    """A struct that is one column: its values beside its name or unit, as Simulink and dSPACE write it."""
    columns = [key.casefold() in _VALUES for key, value in struct.items() if _is_column(value)]
    if columns != [True]:
        return None
    texts = {key.casefold(): value for key, value in struct.items() if isinstance(value, str) and value.strip()}
    unit = next((texts[key] for key in _UNITS if key in texts), None)
    title = next((texts[key] for key in _NAMES if key in texts), name)
    return with_unit(title, unit), next(filter(_is_column, struct.values()))


def _is_column(value: object) -> bool:
    if not isinstance(value, np.ndarray) or value.ndim != 1 or len(value) < 2:
        return False
    return value.dtype.kind in f"{_NUMBERS}US" or (
        value.dtype == object and all(isinstance(cell, str) for cell in value)
    )
