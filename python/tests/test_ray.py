"""A folder of recordings on a local Ray cluster that loses a worker."""

import os
import pathlib
import re
import signal
import subprocess
import sys

import pytest

pytest.importorskip("ray")
pyarrow = pytest.importorskip("pyarrow")

from pyarrow import csv, parquet  # noqa: E402

SCRIPT = pathlib.Path(__file__).parent.parent / "examples/ray_predict.py"


def tracks(seed):
    """Ten vehicles on two lanes at 10 Hz, 20 s of them."""
    columns = {"id": [], "time": [], "x": [], "y": []}
    for frame in range(200):
        for vehicle in range(10):
            speed = 20 + (seed + vehicle) % 7
            row = (vehicle + 1, frame / 10, 60.0 * vehicle + speed * frame / 10, 1.8 + 3.6 * (vehicle % 2))
            for column, value in zip(columns.values(), row):
                column.append(value)
    return pyarrow.table(columns)


def test_a_killed_worker_loses_and_doubles_nothing(tmp_path):
    source, output = tmp_path / "tracks", tmp_path / "forecasts"
    source.mkdir()
    for seed in range(5):
        parquet.write_table(tracks(seed), source / f"part-{seed}.parquet")
    csv.write_csv(tracks(5), source / "part-5.csv")
    command = [sys.executable, SCRIPT, "--input", source, "--output", output, "--every", "2"]
    killed, reports = None, []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as driver:
        for line in driver.stdout:
            if found := re.search(r"\d+ of 6: (\S+), \d+ rows, by process (\d+)", line):
                reports.append(found.groups())
                if killed is None:
                    killed = int(found[2])
                    os.kill(killed, signal.SIGKILL)
    assert driver.returncode == 0
    names = [f"part-{seed}" for seed in range(6)]
    assert sorted(name for name, _ in reports) == names
    # The other worker went on; one in the place of the killed one came if there was still work when it was ready.
    assert killed is not None and any(int(process) != killed for _, process in reports)
    assert sorted(path.name for path in output.iterdir()) == [f"{name}.parquet" for name in names]
    alone = tmp_path / "alone"
    program = [sys.executable, "-m", "gnp", "predict", "--input", source, "--output", alone, "--every", "2", "--k", "6"]
    subprocess.run(program, check=True)
    columns = ["vehicle_name", "time_s", "mode", "step", "probability", "x", "y"]
    for name in names:
        forecasts, others = (parquet.read_table(folder / f"{name}.parquet").select(columns) for folder in (output, alone))
        assert forecasts.num_rows > 0
        assert forecasts.to_pydict() == others.to_pydict()
    before = {path: path.stat().st_mtime_ns for path in output.iterdir()}
    said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    assert "0 of 6 recordings to do" in said
    assert before == {path: path.stat().st_mtime_ns for path in output.iterdir()}
