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
