"""Frames pushed one by one."""

from __future__ import annotations

import threading

import numpy as np
import polars as pl
import pytest

import gnp
from gnp.online import Stream

LINES = [-1.8, 1.8, 5.4]


def frames(tracks):
    for time in np.unique(tracks["time"]):
        rows = tracks["time"] == time
        yield float(time), {name: values[rows] for name, values in tracks.items() if name != "time"}


def run(model, tracks, **options):
    stream = Stream(model, LINES, **options)
    for time, frame in frames(tracks):
        answer = stream.push(time, frame)
    return answer


def test_a_stream_equals_the_batch(tracks, model):
    frame = run(model, tracks)
    assert frame.validity == ["full"] * 5 and frame.time_s == pytest.approx(104.0) and len(frame) == 5
    expected = pl.DataFrame(model.predict(tracks, lines=LINES))
    for row, vehicle in enumerate(frame.ids):
        rows = expected.filter(vehicle=int(vehicle))
        paths = rows.select("x", "y").to_numpy().reshape(6, 50, 2)
        np.testing.assert_allclose(frame.paths[row], paths, atol=2e-3)
        np.testing.assert_allclose(frame.probabilities[row], rows.filter(step=1)["probability"], atol=1e-4)


def test_the_first_frame_says_what_it_rests_on(tracks, model):
    stream = Stream(model, LINES, k=3, forces=True)
    time, frame = next(frames(tracks))
    answer = stream.push(time, pl.DataFrame(frame))
    assert answer.validity == ["filled"] * 5 and answer.paths.shape == (5, 3, 50, 2)
    assert np.isfinite(answer.paths).all() and (answer.observed_s == 0).all()
    assert answer.forces["goal"].shape == (5, 3, 50, 2)
    without = {name: values for name, values in frame.items() if name not in ("vx", "vy")}
    answer = Stream(model, LINES).push(time, without)
    assert answer.validity == ["not"] * 5 and np.isnan(answer.paths).all()
    assert "velocity" in answer.reasons[0]


def test_one_bad_track_does_not_blind(tracks, model):
    stream = Stream(model, LINES)
    for time, frame in frames(tracks):
        frame["x"] = np.where(frame["id"] == 7, np.nan, frame["x"])
        answer = stream.push(time, frame)
    assert [problem.id for problem in answer.problems] == [7] and "position" in answer.problems[0].reason
    predicted = dict(zip(answer.ids.tolist(), answer.validity, strict=True))
    assert all(predicted[vehicle] == "full" for vehicle in (3, 4, 8, 9))


def test_what_cannot_be_is_refused(tracks, model):
    stream = Stream(model, LINES)
    _, frame = next(frames(tracks))
    stream.push(1.0, frame)
    with pytest.raises(gnp.OnlineError, match="grow"):
        stream.push(1.0, frame)
    assert len(stream.push(1.1, frame)) == 5
    stream.reset()
    assert len(stream.push(0.0, {"id": [], "x": [], "y": []})) == 0
    with pytest.raises(gnp.TracksError, match="`y`"):
        stream.push(2.0, {"id": [1], "x": [0.0]})
    with pytest.raises(gnp.TracksError, match="whole"):
        stream.push(2.0, {"id": ["a"], "x": [0.0], "y": [0.0]})
    # Feet are no metres.
    with pytest.raises(gnp.GnpError, match="in m: lanes are 1 to 8 m wide"):
        Stream(model, [0.0, 12.0, 24.0])
    with pytest.raises(gnp.GnpError, match="lines"):
        Stream(model, [0.0])
    with pytest.raises(ValueError, match="k is 0"):
        Stream(model, LINES, k=0)


def test_streams_share_a_model(tracks, model):
    answers = {}

    def work(name):
        answers[name] = run(model, tracks).paths

    threads = [threading.Thread(target=work, args=(name,)) for name in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal(answers[0], answers[1])
    np.testing.assert_array_equal(answers[0], answers[2])
