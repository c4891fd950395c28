"""What is predicted, when, for whom; long work can be watched and stopped."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import polars as pl
import pytest
from conftest import constant_tracks

import gnp


def test_a_row_for_each_step_of_each_future(tracks, model):
    forecasts = pl.DataFrame(model.predict(tracks, out="table"))
    assert forecasts.height == 5 * 6 * 50
    assert forecasts["vehicle"].unique().sort().to_list() == [3, 4, 7, 8, 9]
    assert forecasts["time_s"].unique().to_list() == [104.0]
    assert forecasts["horizon_s"].max() == pytest.approx(5.0)
    assert (forecasts["past"] == "full").all()
    sums = forecasts.filter(step=1).group_by("vehicle").agg(pl.col("probability").sum())
    np.testing.assert_allclose(sums["probability"], 1.0, atol=1e-5)
    assert forecasts.select(pl.col(pl.Float64, pl.Float32).is_finite().all()).row(0) == (True,) * 8


def test_a_vehicle_of_constant_speed_goes_on(tracks, model):
    forecasts = pl.DataFrame(model.predict(tracks, k=1))
    for vehicle, x, y in [(7, 225.0, 0.0), (3, 310.0, 3.6)]:
        end = forecasts.filter(vehicle=vehicle, step=50)
        assert end["x"][0] == pytest.approx(x, abs=8.0)
        assert end["y"][0] == pytest.approx(y, abs=0.8)
        first = forecasts.filter(vehicle=vehicle, step=1)
        assert first["x"][0] == pytest.approx(x - 4.9 * (25.0 if vehicle == 7 else 30.0), abs=0.2)


def test_coordinates_are_those_of_the_tracks(tracks, model):
    """The same traffic, turned by 130 degrees and moved by kilometres, is predicted as it was, turned and moved."""
    turn, move = np.deg2rad(130.0), np.array([-4e5, 5.4e6])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])

    def moved(x, y, by):
        return rotation @ np.stack([x, y]) + np.array(by)[:, None]

    turned = dict(tracks)
    turned["x"], turned["y"] = moved(tracks["x"], tracks["y"], move)
    turned["vx"], turned["vy"] = moved(tracks["vx"], tracks["vy"], [0.0, 0.0])
    expected, found = model.predict(tracks, k=2), model.predict(turned, k=2)
    x, y = moved(expected["x"], expected["y"], move)
    np.testing.assert_allclose(found["x"], x, atol=0.05)
    np.testing.assert_allclose(found["y"], y, atol=0.05)


def test_moments_are_asked_for(tracks, model):
    def moments(**options):
        return sorted(set(model.predict(tracks, k=1, **options)["time_s"].round(6)))

    assert moments() == [104.0]
    assert moments(at=103.5) == [103.5]
    assert moments(at=[103.0, 103.5, 103.0]) == [103.0, 103.5]
    assert moments(at="every", every=0.5)[-3:] == [103.0, 103.5, 104.0]
    for time in (99.0, 105.0):
        with pytest.warns(gnp.GnpWarning, match="1 asked times outside"):
            assert moments(at=[time, 104.0]) == [104.0]
    with pytest.raises(ValueError, match="noon"):
        model.predict(tracks, at="noon")
    with pytest.raises(ValueError, match="every"):
        model.predict(tracks, at="every", every=0.0)
    with pytest.raises(ValueError, match="k is 0"):
        model.predict(tracks, k=0)


def test_the_future_is_not_seen(tracks, model):
    expected = model.predict(tracks, at=103.0)
    later = tracks["time"] > 103.05
    changed = {name: values[~later] for name, values in tracks.items()}
    found = model.predict(changed, at=103.0)
    for name in ("x", "y", "probability"):
        np.testing.assert_allclose(found[name], expected[name], atol=2e-3)


def test_short_pasts_are_filled_and_said(tracks, model):
    short = (tracks["id"] != 9) | (tracks["time"] > 102.95)
    forecasts = pl.DataFrame(model.predict({name: values[short] for name, values in tracks.items()}, k=1))
    of_9 = forecasts.filter(vehicle=9)
    assert of_9["past"][0] == "filled" and of_9["observed_s"][0] == pytest.approx(1.0)
    assert set(forecasts.filter(pl.col("vehicle") != 9)["past"]) == {"full"}


def test_ten_rows_a_vehicle_are_enough(model):
    forecasts = model.predict({name: values for name, values in constant_tracks(0.9).items() if name not in ("vx", "vy")}, k=1)
    assert forecasts["x"].size == 5 * 50 and set(forecasts["past"]) == {"filled"}


def test_a_higher_rate_is_thinned_and_another_is_an_error(model):
    at_10, at_50 = model.predict(constant_tracks(), k=1), model.predict(constant_tracks(rate=50.0), k=1)
    np.testing.assert_allclose(at_50["x"], at_10["x"], atol=0.3)
    with pytest.raises(gnp.TracksError, match="Hz"):
        model.predict(constant_tracks(rate=12.0))


def test_forces_come_when_asked_for(tracks, model):
    forecasts = model.predict(tracks, k=1, forces=True)
    names = [name for name in forecasts if name.startswith("force_")]
    assert "force_goal_x" in names and "force_goal_y" in names
    assert all(np.isfinite(forecasts[name]).all() for name in names)
    assert not [name for name in model.predict(tracks, k=1) if name.startswith("force_")]


def test_a_curved_road_is_followed(model):
    """Traffic on an arc of 800 m is predicted on the arc."""
    tracks, radius = constant_tracks(), 800.0
    angle = tracks["x"] / radius
    bent = {"id": tracks["id"], "time": tracks["time"]}
    bent["x"], bent["y"] = (radius - tracks["y"]) * np.sin(angle), radius - (radius - tracks["y"]) * np.cos(angle)
    s = np.arange(-100.0, 700.0, 10.0)
    road = np.stack([radius * np.sin(s / radius), radius - radius * np.cos(s / radius)], axis=1)
    with pytest.raises(gnp.TracksError, match="straight|turn"):
        model.predict(bent)
    forecasts = pl.DataFrame(model.predict(bent, k=1, road=road))
    end = forecasts.filter(vehicle=7, step=50)
    assert np.hypot(end["x"][0], radius - end["y"][0]) == pytest.approx(radius, abs=0.8)
    with pytest.raises(gnp.TracksError, match="road"):
        model.predict(bent, road=[[0.0, 0.0]])


def test_any_number_of_threads_gives_the_same(tracks, model):
    one, two = (model.predict(tracks, at="every", every=0.5, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one["x"], two["x"])
    with pytest.raises(ValueError, match="threads"):
        model.predict(tracks, threads=0)


def test_progress_is_told_and_may_stop_the_work(tracks, model):
    told = []
    model.predict(tracks, at="every", every=0.5, progress=lambda *report: told.append(report))
    assert told[0] == ("predict", 0, 45) and told[-1] == ("predict", 45, 45)

    def stop(what, done, total):
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        model.predict(tracks, at="every", every=0.1, progress=stop)


def test_other_threads_go_on(tracks, model):
    """The GIL is free while a model works: another thread of Python counts meanwhile."""
    counted, done = 0, threading.Event()

    def count():
        nonlocal counted
        while not done.is_set():
            counted += 1
            time.sleep(0.001)

    counter = threading.Thread(target=count)
    counter.start()
    start = time.perf_counter()
    model.predict(tracks, at="every", every=0.1)
    seconds = time.perf_counter() - start
    done.set()
    counter.join()
    assert counted > 20 * seconds, (counted, seconds)


@pytest.mark.skipif(sys.platform == "win32", reason="no such signal")
def test_ctrl_c_ends_long_work(tmp_path):
    program = textwrap.dedent(
        """
        import gnp, sys
        sys.path.insert(0, sys.argv[1])
        from conftest import constant_tracks
        tracks, model = constant_tracks(600.0), gnp.load()
        try:
            model.predict(tracks, at="every", every=0.1, k=20, progress=lambda *_: print("working", flush=True))
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        """
    )
    folder = str(__file__).rpartition("/")[0]
    process = subprocess.Popen([sys.executable, "-c", program, folder], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "working\n"
    process.send_signal(signal.SIGINT)
    assert process.stdout.read().rpartition("working\n")[2] == "interrupted\n"
    assert process.wait(60) == 0
