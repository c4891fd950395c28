"""Prediction while vehicles drive: one frame of tracks in, for every vehicle its likely paths out.

    >>> stream = gnp.online.Stream(gnp.load(), lines=[0.0, 3.7, 7.4])    # two lanes
    >>> frame = stream.push(12.04, {"id": [17, 4], "x": [361.2, 402.0], "y": [1.8, 5.6]})
    >>> frame.paths.shape                                               # vehicles, futures, steps, (x, y)
    (2, 6, 50, 2)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _gnp
from ._model import Model, numbers, points
from ._tables import source_of

__all__ = ["Frame", "Problem", "Stream"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """A track that was not taken as it came."""

    #: Its place in the frame that was pushed.
    row: int
    #: Its id.
    id: int
    #: What is wrong, and what was done.
    reason: str


class Frame:
    """What a stream gives for a frame. The first axis of every array is the vehicle: those pushed, then those missing.

    Numbers of vehicles without a forecast are NaN.
    """

    def __init__(self, frame: _gnp.Frame) -> None:
        self._frame = frame

    def _array(self, name: str, *shape: int) -> Array:
        out = np.empty(int(np.prod(shape)), np.float64)
        self._frame.fill(name, out)
        return out.reshape(shape)

    @property
    def time_s(self) -> float:
        """Time of the frame, s."""
        return self._frame.time_s

    @cached_property
    def ids(self) -> NDArray[np.int64]:
        """`[vehicles]`, who they are."""
        return np.array(self._frame.ids(), np.uint64).astype(np.int64)

    @cached_property
    def validity(self) -> list[str]:
        """What each forecast rests on: "full"; "filled", a short past, the rest taken to be at constant velocity;
        "interpolated", a past with a gap; "not", no forecast."""
        return self._frame.validity()

    @cached_property
    def reasons(self) -> list[str | None]:
        """Why there is no forecast, of each vehicle; None where there is one."""
        return self._frame.reasons()

    @cached_property
    def paths(self) -> Array:
        """`[vehicles, k, steps, 2]`, m, in the coordinates of the tracks; the first path is the prediction, the first step
        one frame of the model after now."""
        return self._array("paths", *self._frame.shape(), 2)

    @cached_property
    def probabilities(self) -> Array:
        """`[vehicles, k]`, summing to 1."""
        return self._array("probabilities", *self._frame.shape()[:2])

    @cached_property
    def position(self) -> Array:
        """`[vehicles, 2]`, centre now, m: as given, or where the vehicle is taken to be while it is missing."""
        return self._array("position", self._frame.shape()[0], 2)

    @cached_property
    def age_s(self) -> Array:
        """`[vehicles]`, time since the vehicle was seen last, s; 0 if it is in the frame."""
        return self._array("age_s", self._frame.shape()[0])

    @cached_property
    def observed_s(self) -> Array:
        """`[vehicles]`, for how long a vehicle with a filled past was seen, s; NaN for others."""
        return self._array("observed_s", self._frame.shape()[0])

    @cached_property
    def gap_s(self) -> Array:
        """`[vehicles]`, largest time between two samples of the past, s."""
        return self._array("gap_s", self._frame.shape()[0])

    @cached_property
    def forces(self) -> dict[str, Array]:
        """By term `[vehicles, k, steps, 2]`, along the road and to the left, m/s²; empty unless the stream was asked for forces."""
        return {name: self._array(f"force_{name}", *self._frame.shape(), 2) for name in self._frame.forces()}

    @cached_property
    def problems(self) -> list[Problem]:
        """Tracks that were not taken as they came; all others were predicted."""
        return [Problem(*problem) for problem in self._frame.problems()]

    def __len__(self) -> int:
        return self._frame.shape()[0]

    def __repr__(self) -> str:
        vehicles, futures, steps = self._frame.shape()
        return f"gnp.online.Frame at {self.time_s} s: {vehicles} vehicles, {futures} futures of {steps} steps"


class Stream:
    """The vehicles of one carriageway, predicted frame by frame. Many streams may share one model.

    Coordinates are those of one fixed plane, m: x forward along the road and y to the left, or any with `road`. Frames may
    come at any rate and irregularly. A bad track is left out and reported (`Frame.problems`), all others are predicted.
    Memory is bounded. A stream may be used from several threads, one after the other.

    Args:
        model: from `gnp.load`.
        lines: lateral positions of the lane lines, m, from right to left; at least two.
        k: futures a vehicle.
        road: points of a line along the road, `[points, 2]` in m, for a road that curves.
        site: whose drivers the traffic ahead is rolled out with; those of all sites of the model where None.
        coast_s: how long a missing vehicle is taken to go on, s.
        bridge_s: longest gap that is interpolated, s; a vehicle missing for longer is forgotten.
        max_vehicles: how many are remembered at once.
        max_rate_hz: samples of a vehicle kept in a second.
        forces: with the forces behind the paths, which takes longer.

    Raises:
        gnp.OnlineError: for lines that make no lane.
        ValueError: for a number out of its range, and for lines that look like feet.
    """

    def __init__(
        self,
        model: Model,
        lines: Iterable[float],
        *,
        k: int = 6,
        road: Iterable[Sequence[float]] | None = None,
        site: str | None = None,
        coast_s: float = 0.5,
        bridge_s: float = 1.0,
        max_vehicles: int = 512,
        max_rate_hz: float = 100.0,
        forces: bool = False,
    ) -> None:
        options = (points(road), site, coast_s, bridge_s, max_vehicles, max_rate_hz, forces)
        self._stream = _gnp.Stream(model._model, numbers(lines) or [], k, *options)

    def push(self, time_s: float, tracks: Any) -> Frame:
        """Takes the vehicles that were detected at a time, and predicts them and those that are missing for a while.

        Args:
            time_s: time of the frame, s; later than that of the one before.
            tracks: a row for a vehicle, as for `Model.predict`: `id` (whole numbers), `x`, `y` (m), and where known `vx`,
                `vy` (m/s), `length`, `width` (m), `class`.

        Raises:
            gnp.OnlineError: when time does not grow; the stream is then as it was.
            gnp.TracksError: for columns that are missing or not of numbers.
        """
        return Frame(self._stream.push(time_s, source_of(tracks)))

    def set_lines(self, lines: Iterable[float]) -> None:
        """Moves the lane lines, m, from right to left, from the next frame on."""
        self._stream.set_lines(numbers(lines) or [])

    def reset(self) -> None:
        """Forgets all vehicles and the time."""
        self._stream.reset()
