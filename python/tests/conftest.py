"""Tracks that the tests share."""

from __future__ import annotations

import numpy as np
import pytest

import gnp

RATE = 10.0


def constant_tracks(seconds: float = 4.0, rate: float = RATE) -> dict[str, np.ndarray]:
    """Five vehicles at constant speeds in two lanes of 3.6 m, without anybody near: id, time, x, y, vx, vy."""
    times = np.arange(round(seconds * rate) + 1) / rate
    vehicles = [(7, 0.0, 0.0, 25.0), (8, 90.0, 0.0, 25.0), (9, 180.0, 0.0, 25.0), (3, 40.0, 3.6, 30.0), (4, 160.0, 3.6, 30.0)]
    columns = {name: [] for name in ("id", "time", "x", "y", "vx", "vy")}
    for number, x, y, speed in vehicles:
        columns["id"].append(np.full(times.size, number))
        columns["time"].append(100.0 + times)
        columns["x"].append(x + speed * times)
        columns["y"].append(np.full(times.size, y))
        columns["vx"].append(np.full(times.size, speed))
        columns["vy"].append(np.zeros(times.size))
    return {name: np.concatenate(values) for name, values in columns.items()}


@pytest.fixture
def tracks() -> dict[str, np.ndarray]:
    return constant_tracks()


@pytest.fixture(scope="session")
def model() -> gnp.Model:
    return gnp.load()
