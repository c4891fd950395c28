"""The loop with SUMO, in short."""

import importlib.util
import json
import pathlib
import shutil
import subprocess
import sys

import pytest

pytest.importorskip("pyarrow")

SCRIPT = pathlib.Path(__file__).parent.parent / "examples/sumo_loop.py"
HAS_SUMO = importlib.util.find_spec("sumo") or shutil.which("sumo")


@pytest.mark.skipif(not HAS_SUMO, reason="eclipse-sumo is not installed")
def test_forecasts_are_where_sumo_drives(tmp_path):
    command = [sys.executable, SCRIPT, "--gnp", f"{sys.executable} -m gnp", "--out", tmp_path / "loop"]
    said = subprocess.run([*command, "--seconds", "90", "--every", "10"], check=True, stdout=subprocess.PIPE, text=True)
    assert "SIMULATED" in said.stdout
    scores = json.loads((tmp_path / "loop/scores.json").read_text())
    prediction, constant = scores["prediction"], scores["constant velocity"]
    # Where and when forecasts are is right to within what traffic does in a second.
    error, count = prediction["1"]
    assert count > 100 and error < 1.0
    assert constant["1"][0] < 1.0
    assert scores["best path"]["5"][0] < prediction["5"][0]
