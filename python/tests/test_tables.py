"""Tables of every library go in and come out as the same numbers."""

from __future__ import annotations

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from numpy.testing import assert_array_equal

import gnp


def structured(tracks):
    array = np.empty(len(tracks["id"]), dtype=[(name, values.dtype) for name, values in tracks.items()])
    for name, values in tracks.items():
        array[name] = values
    return array


KINDS = {
    "polars": (pl.DataFrame, pl.DataFrame),
    "lazy": (lambda tracks: pl.DataFrame(tracks).lazy(), pl.DataFrame),
    "chunks": (lambda tracks: pl.concat([pl.DataFrame(tracks)[:50], pl.DataFrame(tracks)[50:]], rechunk=False), pl.DataFrame),
    "pandas": (pd.DataFrame, pd.DataFrame),
    "pyarrow": (pa.table, pa.Table),
    "batch": (lambda tracks: pa.record_batch(tracks), pa.Table),
    "numpy": (dict, dict),
    "lists": (lambda tracks: {name: values.tolist() for name, values in tracks.items()}, dict),
    "structured": (structured, dict),
    "float32": (lambda tracks: pl.DataFrame(tracks).with_columns(pl.col("id").cast(pl.Int16)), pl.DataFrame),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_table_gives_the_same_and_comes_back(kind, tracks, model):
    make, back = KINDS[kind]
    expected = model.predict(tracks, k=2)
    forecasts = model.predict(make(tracks), k=2)
    assert isinstance(forecasts, back)
    assert list(getattr(forecasts, "column_names", getattr(forecasts, "columns", forecasts))) == list(expected)
    for name, values in expected.items():
        assert_array_equal(np.asarray(forecasts[name]), values, err_msg=name)


def test_what_comes_out_can_be_chosen(tracks, model):
    table = model.predict(tracks, out="table")
    assert isinstance(table, gnp.Table) and len(table) == 5 * 6 * 50
    assert isinstance(model.predict(tracks, out="polars"), pl.DataFrame)
    assert isinstance(model.predict(table_of_names(tracks), out="pandas"), pd.DataFrame)
    assert isinstance(pl.DataFrame(table), pl.DataFrame)
    with pytest.raises(ValueError, match="spark"):
        model.predict(tracks, out="spark")


def table_of_names(tracks):
    names = np.array([f"car {number}" for number in tracks["id"]])
    return pl.DataFrame({**tracks, "id": names})


def test_numbers_leave_without_a_copy(tracks, model):
    table = model.predict(tracks, out="table")

    def address(column):
        return column.chunk(0).buffers()[1].address

    first, second = table.to_pyarrow(), table.to_pyarrow()
    for name in ("x", "probability", "vehicle"):
        assert address(first[name]) == address(second[name]), name
    assert table.to_polars()["x"].to_arrow().buffers()[1].address == address(first["x"])


def test_numbers_outlive_the_table(tracks, model):
    frame = model.predict(tracks, out="polars")
    array = model.predict(tracks, out="table")["x"]
    array[0] = 0.0  # its own
    assert frame["x"].sum() == model.predict(tracks, out="numpy")["x"].sum()


@pytest.mark.parametrize(
    "names",
    [
        lambda column: column.cast(pl.Categorical),
        lambda column: column.cast(pl.Enum(column.unique())),
        lambda column: column,
    ],
)
def test_names_may_be_texts_or_categories(names, tracks, model):
    frame = table_of_names(tracks)
    forecasts = model.predict(frame.with_columns(names(frame["id"])), k=1)
    assert sorted(forecasts["vehicle_name"].unique()) == ["car 3", "car 4", "car 7", "car 8", "car 9"]
    last = forecasts.filter(vehicle_name="car 7", step=1)
    assert last["x"][0] == pytest.approx(102.5, abs=0.1)
    by_pandas = model.predict(pd.DataFrame(frame.to_dict(as_series=False)).astype({"id": "category"}), k=1)
    assert by_pandas["vehicle_name"].tolist() == forecasts["vehicle_name"].to_list()


def test_times_may_be_dates(tracks, model):
    dated = {**tracks, "time": (tracks["time"] * 1e9).astype("int64").astype("datetime64[ns]")}
    expected = model.predict(tracks, k=1)
    for table in (dated, pl.DataFrame(dated), pd.DataFrame(dated)):
        np.testing.assert_allclose(np.asarray(model.predict(table, k=1)["x"]), expected["x"], atol=1e-3)


@pytest.mark.parametrize(
    ("change", "row", "column", "message"),
    [
        (lambda t: {k: v for k, v in t.items() if k != "time"}, None, None, "time"),
        (lambda t: {k: v for k, v in t.items() if k != "vy"}, None, "vy", "both"),
        (lambda t: {**t, "x": np.where(np.arange(t["x"].size) == 44, np.nan, t["x"])}, 44, "x", "NaN"),
        (lambda t: {**t, "x": np.where(np.arange(t["x"].size) == 44, np.inf, t["x"])}, 44, "x", "inf"),
        (lambda t: {**t, "id": np.where(np.arange(t["x"].size) == 12, 0.5, t["id"])}, 12, "id", "0.5"),
        (lambda t: {**t, "x": [str(value) for value in t["x"]]}, 0, "x", "text"),
        (lambda t: {**t, "x": [None, *t["x"][1:].tolist()]}, 0, "x", "None"),
        (lambda t: {**t, "class": t["id"]}, None, "class", "words"),
        (lambda t: {**t, "y": np.stack([t["y"], t["y"]])}, None, None, "dimensions"),
        (lambda t: {name: values[:0] for name, values in t.items()}, None, None, "no tracks"),
        (lambda t: {**t, "x": t["x"][:-1]}, None, None, "rows"),
        (lambda t: 17, None, None, "int is no table"),
    ],
)
def test_bad_tracks_name_row_and_column(change, row, column, message, tracks, model):
    with pytest.raises(gnp.TracksError, match=message) as caught:
        model.predict(change(tracks))
    assert (getattr(caught.value, "row", None), getattr(caught.value, "column", None)) == (row, column)


def test_missing_texts_name_their_row(tracks, model):
    frame = table_of_names(tracks)
    names = frame["id"].to_list()
    names[7] = None
    with pytest.raises(gnp.TracksError, match="row 7, column `id`") as caught:
        model.predict(frame.with_columns(pl.Series("id", names)))
    assert (caught.value.row, caught.value.column) == (7, "id")
