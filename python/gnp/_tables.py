"""Tables of other libraries, in and out, without importing a library that the caller does not use."""

from __future__ import annotations

import importlib
from array import array
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, get_args

from . import _gnp

Kind = Literal["polars", "pandas", "pyarrow", "numpy", "table"]


def kind_of(table: Any) -> Kind:
    """The library that an answer to `table` should be of."""
    if isinstance(table, Table):
        return "table"
    module = type(table).__module__.partition(".")[0]
    if module in ("polars", "pandas", "pyarrow", "numpy"):
        return module  # type: ignore[return-value]
    return "numpy" if isinstance(table, Mapping) else "table"


def check_kind(kind: str) -> Kind:
    """`kind`, or a ValueError that says what there is."""
    if kind not in get_args(Kind):
        raise ValueError(f"out is {kind!r}, but must be one of {', '.join(map(repr, get_args(Kind)))}")
    return kind  # type: ignore[return-value]


def source_of(table: Any) -> Any:
    """What the compiled part reads: an object with `__arrow_c_stream__`, or a list of names and columns.

    Columns of polars, PyArrow and of pandas (where PyArrow is installed) stay where they are. Columns of NumPy, and of lists,
    are made float64 or int64.
    """
    if type(table).__module__.partition(".")[0] == "polars" and hasattr(table, "collect"):
        table = table.collect()
    if type(table).__module__.partition(".")[0] == "pandas":
        try:
            importlib.import_module("pyarrow")
        except ImportError:
            return [(str(name), _column(str(name), table[name].to_numpy())) for name in table.columns]
    if hasattr(table, "__arrow_c_stream__"):
        return table
    if isinstance(table, Mapping):
        return [(str(name), _column(str(name), values)) for name, values in table.items()]
    names = getattr(getattr(table, "dtype", None), "names", None)
    if names:
        return [(name, _column(name, table[name])) for name in names]
    raise _gnp.TracksError(
        f"a {type(table).__name__} is no table: give a data frame of polars or pandas, a table of PyArrow, "
        "a dict of columns, or a structured array of NumPy"
    )


def _column(name: str, values: Any) -> Any:
    """A column as a buffer of float64 or int64, or as a list of str."""
    dtype = getattr(values, "dtype", None)
    kind = getattr(dtype, "kind", None)
    if getattr(values, "ndim", 1) != 1:
        raise _gnp.TracksError(f"column `{name}` has {values.ndim} dimensions: give one number a row")
    if kind == "f":
        return values.astype("float64", order="C", copy=False).copy(order="C")
    if kind in ("i", "u"):
        return values.astype("int64", order="C", copy=False).copy(order="C")
    if kind == "M":
        nanoseconds = values.astype("datetime64[ns]").astype("int64")
        return nanoseconds / 1e9
    items: Sequence[Any] = values.tolist() if hasattr(values, "tolist") else list(values)
    if all(isinstance(item, int) and not isinstance(item, bool) for item in items):
        return array("q", items)
    if all(isinstance(item, (int, float)) and not isinstance(item, bool) for item in items):
        return array("d", items)
    for row, item in enumerate(items):
        if not isinstance(item, str):
            error = _gnp.TracksError(
                f"row {row}, column `{name}`: {item!r} is neither a number nor a text like the rest of the column"
            )
            error.row, error.column = row, name
            raise error
    return list(items)


class Table:
    """Columns by name, for any library.

    It has `__arrow_c_stream__`, so that polars, pandas 3, PyArrow, DuckDB and others take it as it is:
    `polars.DataFrame(table)`, `pyarrow.table(table)`.
    """

    def __init__(self, columns: _gnp.Columns, notes: Sequence[str] = ()) -> None:
        self._columns = columns
        #: What was left out and what was assumed, in sentences.
        self.notes: list[str] = list(notes)

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return self._columns.names()

    def __len__(self) -> int:
        return len(self._columns)

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __getitem__(self, name: str) -> Any:
        """A column: an array of NumPy `[rows]`."""
        import numpy

        dtype = self._columns.dtype(name)
        if dtype == "str":
            return numpy.array(self._columns.texts(name), dtype=object)
        out = numpy.empty(len(self), dtype)
        self._columns.fill(name, out)
        return out

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self._columns.__arrow_c_stream__(requested_schema)

    def to_polars(self) -> Any:
        """A `polars.DataFrame`; numbers are not copied."""
        return importlib.import_module("polars").DataFrame(self)

    def to_pyarrow(self) -> Any:
        """A `pyarrow.Table`; nothing is copied."""
        return importlib.import_module("pyarrow").table(self)

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame`."""
        try:
            importlib.import_module("pyarrow")
        except ImportError:
            return importlib.import_module("pandas").DataFrame(self.to_numpy())
        return self.to_pyarrow().to_pandas()

    def to_numpy(self) -> dict[str, Any]:
        """A dict of arrays `[rows]`, by column; texts are arrays of objects."""
        return {name: self[name] for name in self.columns}

    def to(self, kind: Kind) -> Any:
        """The table as one of `kind`: "polars", "pandas", "pyarrow", "numpy", or "table" for itself."""
        if kind == "table":
            return self
        return getattr(self, f"to_{check_kind(kind)}")()

    def __repr__(self) -> str:
        return f"gnp.Table of {len(self)} rows: {', '.join(self.columns)}"
