"""Forecasts held against what then happened."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from . import _gnp
from ._model import Progress, answer, numbers, points, teller
from ._tables import Kind, check_kind, kind_of, source_of


def evaluate(
    forecasts: Any,
    tracks: Any,
    *,
    protocol: str = "clean",
    name: str = "forecasts",
    observed_s: float = 3.0,
    road: Iterable[Sequence[float]] | None = None,
    lines: Iterable[float] | None = None,
    threads: int | None = None,
    progress: Progress | bool | None = None,
    out: Kind | None = None,
) -> Any:
    """Scores forecasts, anyone's, against what the tracks then did, beside constant velocity on the same windows.

    Args:
        forecasts: a table as `Model.predict` gives it, with the columns `vehicle` or `vehicle_name`, `time_s`, `mode`,
            `probability`, `step`, `horizon_s`, `x`, `y`. Of each vehicle the lowest mode is the prediction.
        tracks: the tracks with what happened after, as for `Model.predict`.
        protocol: "clean", "literature", "paper", "av2", "nuscenes" or "waymo": which metrics, on how many futures.
        name: what the forecasts are called in the table.
        observed_s: past that a vehicle must have for its forecast to be scored, s.
        road, lines: as for `Model.predict`.
        threads, progress, out: as for `Model.predict`.

    Returns:
        A row for each metric of each model: `model`, `metric`, `k` (futures it chooses from; 0: all), `horizon_s`,
        `value` (m, s or a share, as the metric is), `ci_low`, `ci_high` (95 % interval by driver; NaN with fewer than two),
        `windows`, `vehicles`.

    Raises:
        gnp.EvaluationError: for forecasts that cannot be scored.
        gnp.TracksError: for tracks that cannot be.

    Forecasts that are not scored are counted in a `gnp.GnpWarning`.
    """
    kind = kind_of(forecasts) if out is None else check_kind(out)
    columns, remarks = _gnp.score(
        source_of(forecasts),
        source_of(tracks),
        protocol,
        name,
        observed_s,
        points(road),
        numbers(lines),
        threads,
        teller(progress),
    )
    return answer(columns, remarks, kind)
