"""Models, explanations, the program, the stubs."""

from __future__ import annotations

import ast
import importlib.resources
import pathlib
import subprocess
import sys

import numpy as np
import polars as pl
import pytest

import gnp
from gnp import _gnp


def test_the_card_says_what_the_model_is(model):
    card = model.card
    assert card["name"] == "ngsim" and card["windows"]["rate_hz"] == 10.0
    assert card["limits"] and card["licence"]
    assert repr(model).startswith("gnp.Model ngsim")


def test_what_is_no_model_is_said(tmp_path):
    with pytest.raises(gnp.ModelError, match="model"):
        gnp.load(tmp_path / "nothing")
    with pytest.raises(gnp.ModelError, match="model"):
        gnp.load(tmp_path)
    assert issubclass(gnp.ModelError, gnp.GnpError) and issubclass(gnp.TracksError, gnp.GnpError)


def test_a_model_in_bf16_is_near_or_refused(tracks, model):
    with pytest.raises(ValueError, match="f16"):
        gnp.load(precision="f16")
    wanted = model.predict(tracks, out="polars")
    assert gnp.load(precision="f32").predict(tracks, out="polars").equals(wanted)
    try:
        found = gnp.load(precision="bf16").predict(tracks, out="polars")
    except gnp.ModelError as error:
        assert "AVX512-BF16" in str(error)
        return
    assert found.shape == wanted.shape and not found.equals(wanted)


def test_an_explanation_adds_up_to_the_prediction(tracks, model):
    told = model.explain(pl.DataFrame(tracks), 7)
    assert told.vehicle == "7" and told.time_s == 104.0 and told.past == "full"
    assert "vehicle 7" in str(told)
    ends = told.causes.filter(step=50)
    path = pl.DataFrame(model.predict(tracks)).filter(vehicle=7, mode=0, step=50)
    # At 25 m/s it would get 125 m.
    assert 100.0 + 125.0 + ends["dx"].sum() == pytest.approx(path["x"][0], abs=0.01)
    assert set(told.causes["kind"]) <= {"physics", "network"}


def test_an_explanation_needs_a_vehicle_that_is_there(tracks, model):
    with pytest.raises(gnp.TracksError, match="no vehicle 70"):
        model.explain(tracks, 70)
    for time in (3.0, 105.0):
        with pytest.raises(gnp.TracksError, match=f"at {time:.0f} s: it is there from 100.00 s to 104.00 s"):
            model.explain(tracks, 7, at=time)


def test_the_program_comes_with_the_package():
    def run(*arguments):
        return subprocess.run([sys.executable, "-m", "gnp", *arguments], capture_output=True, text=True, check=False)

    version = run("--version")
    assert version.returncode == 0 and gnp.__version__ in version.stdout
    wrong = run("no-such-command")
    assert wrong.returncode != 0 and "no-such-command" in wrong.stderr
    info = run("info")
    assert info.returncode == 0 and "ngsim" in info.stdout


def test_the_program_and_the_package_predict_the_same(tmp_path, tracks, model):
    """Plain tracks as a file and as a table, under other names of their columns."""
    names = {"id": "Track_ID", "time": "timestamp_ms", "x": "position_x", "y": "y_m", "vx": "velocity_x", "vy": "v_y"}
    frame = pl.DataFrame(tracks).with_columns(pl.col("time") * 1000.0, id="car " + pl.col("id").cast(pl.String)).rename(names)
    frame.write_csv(tmp_path / "tracks.csv")
    command = [sys.executable, "-m", "gnp", "predict", "--input", tmp_path / "tracks.csv", "--output", tmp_path / "out.parquet"]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    by_program, by_package = pl.read_parquet(tmp_path / "out.parquet"), model.predict(frame)
    common = [name for name in by_package.columns if name in by_program.columns]
    assert set(by_package.columns) == set(common)
    for name in common:
        if by_package[name].dtype.is_float():
            np.testing.assert_allclose(by_package[name], by_program[name], atol=1e-3, err_msg=name)
        else:
            assert by_package[name].to_list() == by_program[name].to_list(), name


def test_numpy_is_not_imported_before_it_is_needed():
    program = "import gnp, sys; gnp.load(); assert not {'numpy', 'polars', 'pandas', 'pyarrow'} & set(sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_the_stubs_name_what_there_is():
    stub = ast.parse(importlib.resources.files("gnp").joinpath("_gnp.pyi").read_text())
    named = {}
    for node in stub.body:
        if isinstance(node, ast.ClassDef):
            named[node.name] = {member.name for member in node.body if isinstance(member, ast.FunctionDef)}
        elif isinstance(node, ast.FunctionDef):
            named[node.name] = set()
        elif isinstance(node, ast.AnnAssign):
            named[node.target.id] = set()
    there = {name for name in vars(_gnp) if not name.startswith("__")} | {"__version__"}
    # A dict, which has a class in the stubs alone.
    assert set(named) - {"Remarks"} == there
    for name in ("Columns", "Model", "Stream", "Frame"):
        members = {member for member in vars(getattr(_gnp, name)) if not member.startswith("__")}
        assert {member for member in named[name] if not member.startswith("__")} == members, name


def test_types_are_right(monkeypatch):
    pytest.importorskip("mypy")
    import mypy.api

    monkeypatch.setenv("MYPYPATH", str(pathlib.Path(gnp.__file__).parent.parent))
    out, err, status = mypy.api.run(["--strict", "--package", "gnp", "--cache-dir", "/dev/null"])
    assert status == 0, out + err


def test_arrays_of_a_column_are_numpys(tracks, model):
    table = model.predict(tracks, out="table")
    assert isinstance(table["x"], np.ndarray) and table["x"].dtype == np.float64
    assert table["past"].tolist()[0] == "full"
    with pytest.raises(KeyError):
        table["nothing"]
