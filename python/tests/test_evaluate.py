"""Forecasts held against what happened."""

from __future__ import annotations

import polars as pl
import pytest
from conftest import constant_tracks

import gnp


@pytest.fixture(scope="module")
def long():
    return pl.DataFrame(constant_tracks(10.0))


def value(scores, model, metric, k, horizon):
    row = scores.filter(model=model, metric=metric, k=k, horizon_s=horizon)
    assert row.height == 1, scores
    return row["value"][0]


def test_a_forecast_is_scored_beside_constant_velocity(long, model):
    forecasts = model.predict(long, at=[103.0, 104.0, 105.0])
    scores = gnp.evaluate(forecasts, long, name="gnp")
    assert isinstance(scores, pl.DataFrame)
    assert set(scores["model"]) == {"gnp", "constant velocity"} and set(scores["windows"]) == {15}
    # Everybody drives at constant velocity.
    assert value(scores, "constant velocity", "rmse_at", 1, 5.0) < 1e-3
    assert value(scores, "gnp", "rmse_at", 1, 5.0) < 8.0


def test_a_perfect_forecast_has_no_error(long):
    """What happened, as a forecast of one future."""
    now = 104.0
    future = long.filter(pl.col("time") > now + 0.01, pl.col("time") < now + 5.01)
    forecasts = future.select(
        pl.col("id").alias("vehicle"),
        pl.lit(now).alias("time_s"),
        pl.lit(0).alias("mode"),
        pl.lit(1.0).alias("probability"),
        ((pl.col("time") - now) * 10).round().cast(pl.Int64).alias("step"),
        (pl.col("time") - now).round(6).alias("horizon_s"),
        "x",
        "y",
    )
    scores = gnp.evaluate(forecasts, long, protocol="literature")
    assert value(scores, "forecasts", "rmse_at", 1, 5.0) == pytest.approx(0.0, abs=1e-3)
    wrong = gnp.evaluate(forecasts.with_columns(pl.col("x") + 3.0), long, protocol="literature")
    assert value(wrong, "forecasts", "rmse_at", 1, 5.0) == pytest.approx(3.0, abs=1e-3)


def test_what_is_not_scored_is_said(long, model):
    with pytest.warns(gnp.GnpWarning, match="5 forecasts are not scored"):
        gnp.evaluate(model.predict(long, at=[104.0, 109.0], k=1), long)
    forecasts = model.predict(long, at=104.0, k=1)
    unknown = forecasts.with_columns(pl.col("vehicle_name").replace("7", "70"))
    with pytest.warns(gnp.GnpWarning, match="1 vehicles that have no tracks"):
        gnp.evaluate(unknown, long)


def test_bad_forecasts_are_refused(long, model):
    forecasts = model.predict(long, at=104.0, k=1)
    with pytest.raises(gnp.EvaluationError, match="`x`"):
        gnp.evaluate(forecasts.drop("x"), long)
    with pytest.raises(gnp.EvaluationError, match="row 3, column `x`"):
        gnp.evaluate(forecasts.with_columns(pl.Series("x", [*forecasts["x"][:3], float("nan"), *forecasts["x"][4:]])), long)
    with pytest.raises(ValueError, match="protocol"):
        gnp.evaluate(forecasts, long, protocol="best")
    with pytest.raises(gnp.EvaluationError, match="window"):
        gnp.evaluate(forecasts[:0], long)
