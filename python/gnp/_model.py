"""Trained models."""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from . import _gnp
from ._tables import Kind, Table, check_kind, kind_of, source_of

#: Called with what is done ("predict"), how far it is, and how much there is.
Progress = Callable[[str, int, int], object]


class GnpWarning(UserWarning):
    """Something was left out or assumed; the message says what."""


@dataclass(frozen=True)
class Explanation:
    """Why a forecast is what it is: constant velocity and the parts of all causes add up to the predicted path."""

    #: The vehicle, by its name in the tracks.
    vehicle: str
    #: When, s.
    time_s: float
    #: One sentence: how far the vehicle gets, against its present speed, and why.
    sentence: str
    #: A row for each cause and step: `cause`, `kind` ("physics", or "network" for what a network expects), `step`,
    #: `horizon_s`, and `dx`, `dy`, by which the cause moved the vehicle along the road and to its left, m.
    causes: Any
    #: "full", or "filled" for a vehicle that was seen for less than the model looks back.
    past: str

    def __str__(self) -> str:
        return self.sentence


class Model:
    """A trained model: made by `gnp.load`. It may be used from several threads at once."""

    def __init__(self, model: _gnp.Model) -> None:
        self._model = model

    @cached_property
    def card(self) -> dict[str, Any]:
        """What the model is: its data, protocol, scores, limits and licence, as `gnp info --json` prints them."""
        card: dict[str, Any] = json.loads(self._model.card())
        return card

    def predict(
        self,
        tracks: Any,
        *,
        at: Literal["last", "every"] | float | Iterable[float] = "last",
        every: float = 1.0,
        k: int = 6,
        road: Iterable[Sequence[float]] | None = None,
        lines: Iterable[float] | None = None,
        forces: bool = False,
        threads: int | None = None,
        progress: Progress | bool | None = None,
        out: Kind | None = None,
    ) -> Any:
        """Predicts every vehicle that is there at each asked moment; no future is needed.

        Args:
            tracks: A row for a vehicle at a moment, in any order: a data frame of polars or pandas, a table of PyArrow, any
                other object with `__arrow_c_stream__`, a dict of columns, or a structured array of NumPy. Columns: `id`
                (whole numbers or texts), `time` (s), `x`, `y` (m, centre of the box), and where known `heading` (rad,
                anticlockwise from x), `speed`, or `vx` and `vy` (m/s), `length`, `width` (m), `lane`, `class` (car, truck,
                motorcycle, ...). Times must be uniform; the model's rate, or that times a whole number.
            at: "last" for the last moment, "every" for one each `every` seconds, or times, s.
            every: seconds between moments of `at="every"`.
            k: futures a vehicle. The first is the prediction, the others follow by falling probability.
            road: points of a line along the road, `[points, 2]` in m, for a road that curves. Without it the road must be
                straight.
            lines: lateral positions of the lane lines, m, from right to left, growing to the left: from `road`, or without
                it from the line in the direction of travel through the origin. Found from the tracks where None.
            forces: with the force of each term, `force_<term>_x` and `_y`, along the road and to the left, m/s².
            threads: how many; all cores where None.
            progress: called with what is done, how far it is and how much there is; True writes to stderr.
            out: "polars", "pandas", "pyarrow", "numpy" (a dict of arrays) or "table" (`gnp.Table`); what came in where None.

        Returns:
            A table with a row for each step of each future of each vehicle at each moment: `vehicle` and, for ids that are
            no numbers, `vehicle_name`; `time_s`; `mode` (0 is the prediction); `probability`; `step` (from 1); `horizon_s`;
            `x`, `y` (m, as in the tracks); `s`, `d` (m, along the road and to its left); `past` ("full", or "filled" where a
            vehicle was seen for less than the model looks back: the rest is taken to be at constant velocity) and
            `observed_s` (s).

        Raises:
            gnp.TracksError: for tracks that cannot be; its `row` and `column` say where.
            gnp.ModelError: when the model fails.

        Vehicles that are not predicted are counted in a `gnp.GnpWarning`.
        """
        kind = kind_of(tracks) if out is None else check_kind(out)
        times: list[float] | None = None
        if isinstance(at, str):
            if at not in ("last", "every"):
                raise ValueError(f'at is {at!r}, but must be "last", "every" or times in s')
        else:
            times = [float(time) for time in (at if isinstance(at, Iterable) else [at])]
        columns, remarks = self._model.predict(
            source_of(tracks),
            times,
            float(every) if at == "every" else None,
            k,
            points(road),
            numbers(lines),
            forces,
            threads,
            teller(progress),
        )
        return answer(columns, remarks, kind)

    def explain(
        self,
        tracks: Any,
        vehicle: int | str,
        *,
        at: float | None = None,
        road: Iterable[Sequence[float]] | None = None,
        lines: Iterable[float] | None = None,
    ) -> Explanation:
        """Says why the prediction of a vehicle is what it is.

        Args:
            tracks: as for `predict`.
            vehicle: its id.
            at: time, s; the last moment of the vehicle where None.
            road, lines: as for `predict`.

        Raises:
            gnp.TracksError: as `predict`; when there is no such vehicle at that moment.
        """
        told = self._model.explain(source_of(tracks), str(vehicle), at, points(road), numbers(lines))
        name, time_s, sentence, past, columns, remarks = told
        return Explanation(name, time_s, sentence, answer(columns, remarks, kind_of(tracks)), past)

    def __repr__(self) -> str:
        return f"gnp.Model {self.card['name']}: {self.card['title']}"


def load(
    path: str | os.PathLike[str] | None = None, *, precision: Literal["f32", "bf16"] | None = None
) -> Model:
    """Loads a model: a model folder, a run folder, or the one that comes with the package.

    Args:
        path: where it is; None is the one that comes with the package.
        precision: what the networks of its force multiply in: "f32", or "bf16", which takes a processor with AVX512-BF16 and
            rounds what is multiplied to 8 bits: faster, and paths differ by millimetres; None is f32 but for a run that says
            otherwise.

    Raises:
        gnp.ModelError: when there is none, a file of it differs from what was written, or the processor does not multiply bf16.
    """
    return Model(_gnp.Model(path, precision))


def points(road: Iterable[Sequence[float]] | None) -> list[list[float]] | None:
    """A line as the compiled part takes it."""
    if road is None:
        return None
    pairs = [[float(value) for value in point] for point in road]
    if any(len(pair) != 2 for pair in pairs):
        raise ValueError("road must be points of two numbers, x and y in m")
    return pairs


def numbers(values: Iterable[float] | None) -> list[float] | None:
    """Numbers as the compiled part takes them."""
    return None if values is None else [float(value) for value in values]


def teller(progress: Progress | bool | None) -> Progress | None:
    """Who is told of progress."""
    if progress is True:
        return _write_progress
    return progress or None


def _write_progress(what: str, done: int, total: int) -> None:
    end = "\n" if done >= total else ""
    sys.stderr.write(f"\r{what}: {done} of {total}{end}")
    sys.stderr.flush()


def answer(columns: _gnp.Columns, remarks: _gnp.Remarks, kind: Kind) -> Any:
    """A table as the caller wants it, after a warning of what is not in it."""
    for left_out in remarks["left_out"]:
        warnings.warn(left_out, GnpWarning, stacklevel=3)
    return Table(columns, remarks["left_out"] + remarks["notes"]).to(kind)
