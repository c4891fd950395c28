"""The physics on arrays, against its formulas."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import gnp
from gnp import force


def test_the_goal_attracts():
    assert_allclose(force.goal([0, 0], [18, 0], [100, 0], time_left=5, tau=0.5), [4, 0])
    random = np.random.default_rng(1)
    p, v, g = (random.normal(0, 50, (4, 3, 2)) for _ in range(3))
    t, tau = random.uniform(1, 5, (4, 1)), random.uniform(0.5, 2, 3)
    expected = ((g - p) / t[..., None] - v) / np.broadcast_to(tau, (4, 3))[..., None]
    assert_allclose(force.goal(p, v, g, t, tau), expected)


def test_neighbours_push():
    r = np.random.default_rng(2).normal(0, 30, (100, 2))
    d = np.linalg.norm(r, axis=1, keepdims=True)
    assert_allclose(force.vehicle(r, 3.0), 3.0 * np.exp(-d / 26.0) * r / d, rtol=1e-6)
    assert_allclose(force.vehicle([0, 0], 3.0), [0, 0])
    # Behind a box of 10 m and 2 m: 20 m between the centres are 20 - 5 - 2 m between the bumpers.
    assert_allclose(force.boxes([-20, 0], [4, 2], [10, 2], 3.0, 26.0), [-3.0 * np.exp(-13 / 26.0), 0])


def test_lines_push():
    d = np.linspace(-2, 2, 9)
    assert_allclose(force.line(d, 0.5), 2 * 0.5 * d * np.exp(-(d**2)) * (np.abs(d) < 1.9), atol=0.06)
    assert force.line(-1.0, 0.3, kind="boundary", road="right") == pytest.approx(-0.3)
    with pytest.raises(ValueError, match="kind"):
        force.line(d, 0.5, kind="hedge")
    with pytest.raises(ValueError, match="road"):
        force.line(d, 0.5, kind="boundary", road="up")


def test_drivers_follow():
    driver = force.Driver(desired_speed=30.0)
    assert_allclose(force.free_road([0, 15, 30], driver), [1, 1 - 0.5**4, 0], atol=1e-12)
    assert force.interaction(48.6, 20.0, 20.0) == pytest.approx(-0.25)
    assert force.following(14.6, 30.0, 0.0) == -9.0
    gaps = force.equilibrium_gap([10.0, 40.0], driver)
    assert gaps[0] == pytest.approx((2 + 10) / np.sqrt(1 - (1 / 3) ** 4)) and np.isnan(gaps[1])
    # Where the gap is that, nobody accelerates.
    assert force.following(gaps[0] + 4.6, 10.0, 10.0, driver) == pytest.approx(0, abs=1e-9)


def test_a_platoon_closes_up_and_holds():
    rolled = force.platoon([100.0, 60.0, 20.0], [20.0, 25.0, 25.0], [-1, 0, 1], dt=0.1, steps=600)
    assert rolled.position.shape == (3, 600)
    assert_allclose(rolled.position[0, -1], 100 + 20 * 60)
    assert_allclose(rolled.speed[1:, -1], 20, atol=0.1)
    gap = rolled.position[0, -1] - rolled.position[1, -1] - 4.6
    assert gap == pytest.approx(float(force.equilibrium_gap(20.0)), abs=0.5)
    before = np.column_stack([[20.0, 25.0, 25.0], rolled.speed[:, :-1]])
    assert_allclose(rolled.free + rolled.interaction + rolled.habit, (rolled.speed - before) / 0.1, atol=1e-6)


def test_what_cannot_be_is_refused():
    with pytest.raises(gnp.ForceError, match="follows itself through"):
        force.platoon([0.0, 10.0], [20.0, 20.0], [1, 0])
    with pytest.raises(gnp.ForceError, match="must follow another"):
        force.platoon([0.0, 10.0], [20.0, 20.0], [-1, 7])
    with pytest.raises(gnp.ForceError, match="must follow another"):
        force.platoon([0.0, 10.0], [20.0, 20.0], [-1, -2])
    with pytest.raises(gnp.ForceError, match="time_gap"):
        force.platoon([0.0, 10.0], [20.0, 20.0], [1, -1], driver=force.Driver(time_gap=-1.0))
    with pytest.raises(ValueError, match="last axis"):
        force.goal([0, 0, 0], [0, 0], [1, 1], 1, 1)
    with pytest.raises(ValueError, match="broadcast|mismatch"):
        force.vehicle(np.zeros((3, 2)), np.zeros(4))


def test_terms_are_described():
    terms = {term["name"]: term for term in force.terms()}
    assert terms["goal"]["unit"] == "m/s²" and "tau" in terms["goal"]["parameters"]
