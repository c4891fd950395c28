"""The physics of GNP on arrays of NumPy: social forces and car following, in SI units.

Masses are 1, so that a force is an acceleration in m/s². x runs forward along the road, y to the left; positions are those of
a vehicle's centre. Every argument may be a number or an array; arrays are broadcast. A vector is an array whose last axis is
(x, y). Everything is float64, finite for finite arguments, and computed without the GIL.

    >>> import numpy as np, gnp.force as force
    >>> force.goal([0.0, 0.0], [18.0, 0.0], [100.0, 0.0], time_left=5.0, tau=0.5)   # 2 m/s to be gained in 0.5 s
    array([4., 0.])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._gnp import force as _force

__all__ = [
    "Driver",
    "Platoon",
    "boxes",
    "equilibrium_gap",
    "following",
    "free_road",
    "goal",
    "interaction",
    "line",
    "platoon",
    "terms",
    "vehicle",
]

Array = NDArray[np.float64]


def _vector(value: ArrayLike, name: str) -> tuple[Array, Array]:
    """The x and the y of vectors."""
    vector = np.asarray(value, dtype=np.float64)
    if vector.ndim == 0 or vector.shape[-1] != 2:
        raise ValueError(f"{name} has shape {vector.shape}, but its last axis must be (x, y)")
    return vector[..., 0], vector[..., 1]


def _apply(law: Any, arguments: tuple[ArrayLike, ...], width: int | None) -> Array:
    """`law` of broadcast arguments: `[...]`, or `[..., width]`."""
    arrays = np.broadcast_arrays(*(np.asarray(argument, dtype=np.float64) for argument in arguments))
    shape = arrays[0].shape if width is None else (*arrays[0].shape, width)
    out = np.empty(int(np.prod(shape)), dtype=np.float64)
    law(*(np.ascontiguousarray(array).reshape(-1) for array in arrays), out)
    return out.reshape(shape)


@dataclass(frozen=True)
class Driver:
    """A driver of the intelligent driver model. Each number may be an array, one value a vehicle."""

    #: Speed on an empty road, m/s.
    desired_speed: ArrayLike = 120 / 3.6
    #: Time to the vehicle ahead at a steady speed, s.
    time_gap: ArrayLike = 1.0
    #: Gap to the vehicle ahead at standstill, bumper to bumper, m.
    standstill_gap: ArrayLike = 2.0
    #: Acceleration of a standing vehicle on an empty road, m/s².
    acceleration: ArrayLike = 1.0
    #: Comfortable braking, a positive number, m/s².
    braking: ArrayLike = 1.5

    def _columns(self) -> tuple[ArrayLike, ...]:
        return self.desired_speed, self.time_gap, self.standstill_gap, self.acceleration, self.braking


def goal(position: ArrayLike, velocity: ArrayLike, goal: ArrayLike, time_left: ArrayLike, tau: ArrayLike) -> Array:
    """Attraction by a goal, `((goal - position) / time_left - velocity) / tau`.

    Args:
        position: `[..., 2]`, m.
        velocity: `[..., 2]`, m/s.
        goal: `[..., 2]`, m.
        time_left: `[...]`, until the goal is due, s.
        tau: `[...]`, relaxation time, s.

    Returns:
        `[..., 2]`, m/s².
    """
    vectors = (*_vector(position, "position"), *_vector(velocity, "velocity"), *_vector(goal, "goal"))
    return _apply(_force.goal, (*vectors, time_left, tau), 2)


def vehicle(separation: ArrayLike, k: ArrayLike, r_col: ArrayLike = 26.0) -> Array:
    """Push away from a neighbour, both points, `k exp(-d / r_col)` along the line between them.

    Args:
        separation: `[..., 2]`, from the neighbour to the vehicle, m.
        k: `[...]`, strength, m/s².
        r_col: `[...]`, distance over which the push falls to 1/e, m.

    Returns:
        `[..., 2]`, m/s²; 0 where both coincide, never above `k`.
    """
    return _apply(_force.vehicle, (*_vector(separation, "separation"), k, r_col), 2)


def boxes(
    separation: ArrayLike, size: ArrayLike, other_size: ArrayLike, k: ArrayLike, r_col: ArrayLike = 26.0
) -> Array:
    """Push away from a neighbour, both boxes along the road: `k` at contact, more where they overlap.

    Args:
        separation: `[..., 2]`, from the neighbour's centre to the vehicle's, m.
        size: `[..., 2]`, length and width of the vehicle, m.
        other_size: `[..., 2]`, length and width of the neighbour, m.
        k: `[...]`, strength, m/s².
        r_col: `[...]`, gap over which the push falls to 1/e, m.

    Returns:
        `[..., 2]`, m/s².
    """
    vectors = (*_vector(separation, "separation"), *_vector(size, "size"), *_vector(other_size, "other_size"))
    return _apply(_force.boxes, (*vectors, k, r_col), 2)


def line(distance: ArrayLike, k: ArrayLike, *, kind: str = "divider", road: str = "left") -> Array:
    """Lateral push of a line on the road, positive to the left.

    Args:
        distance: `[...]`, lateral position of the vehicle less that of the line, m.
        k: `[...]`, strength, m²/s² for a divider, m⁴/s² for a boundary.
        kind: "divider", between lanes, pushes to both sides and may be crossed; "boundary" pushes to the road's side.
        road: the side of a boundary on which the road lies, "left" or "right".

    Returns:
        `[...]`, m/s².
    """
    return _apply(lambda d, k, out: _force.line(kind, road, d, k, out), (distance, k), None)


def free_road(speed: ArrayLike, driver: Driver = Driver()) -> Array:
    """Acceleration on an empty road, `a (1 - (v / v0)^4)`.

    Args:
        speed: `[...]`, along the road, m/s.
        driver: how the vehicle is driven.

    Returns:
        `[...]`, m/s².
    """
    return _following("free", 1e9, 0.0, speed, speed, driver)


def interaction(
    distance: ArrayLike, speed: ArrayLike, leader_speed: ArrayLike, driver: Driver = Driver(), body: ArrayLike = 4.6
) -> Array:
    """Acceleration due to the vehicle ahead, `-a (s* / s)²`; at most 0. Arguments as for `following`."""
    return _following("interaction", distance, body, speed, leader_speed, driver)


def following(
    distance: ArrayLike, speed: ArrayLike, leader_speed: ArrayLike, driver: Driver = Driver(), body: ArrayLike = 4.6
) -> Array:
    """Acceleration of a vehicle behind another one: `free_road` and `interaction`, never below -9 m/s².

    Args:
        distance: `[...]`, centre of the leader less that of the vehicle, along the road, m.
        speed: `[...]`, of the vehicle, m/s.
        leader_speed: `[...]`, of the leader, m/s.
        driver: how the vehicle is driven.
        body: `[...]`, mean of both lengths, m, so that the gap is `distance - body`.

    Returns:
        `[...]`, m/s².
    """
    return _following("both", distance, body, speed, leader_speed, driver)


def _following(
    part: str, distance: ArrayLike, body: ArrayLike, speed: ArrayLike, leader_speed: ArrayLike, driver: Driver
) -> Array:
    columns = (distance, body, speed, leader_speed, *driver._columns())
    return _apply(lambda *arrays: _force.following(part, *arrays), columns, None)


def equilibrium_gap(speed: ArrayLike, driver: Driver = Driver()) -> Array:
    """Gap at which a driver keeps a speed behind a vehicle of that speed, bumper to bumper.

    Args:
        speed: `[...]`, m/s.
        driver: how the vehicle is driven.

    Returns:
        `[...]`, m; NaN from the desired speed on, where no gap is large enough.
    """
    return _apply(_force.equilibrium_gap, (speed, driver.desired_speed, driver.time_gap, driver.standstill_gap), None)


@dataclass(frozen=True)
class Platoon:
    """Vehicles that follow each other, after a roll-out; every array is `[vehicles, steps]`.

    Position and speed of a step are those at its end, the parts of the acceleration those that acted in it.
    """

    #: Centre along the road, m.
    position: Array
    #: Speed, m/s.
    speed: Array
    #: Part of the free road in the acceleration, m/s².
    free: Array
    #: Part of the vehicle ahead, m/s².
    interaction: Array
    #: Part of the habit, m/s².
    habit: Array


def platoon(
    position: ArrayLike,
    speed: ArrayLike,
    leader: ArrayLike,
    *,
    driver: Driver = Driver(),
    length: ArrayLike = 4.6,
    habit: ArrayLike = 0.0,
    dt: float = 0.1,
    steps: int = 50,
    decay: float = 0.0,
) -> Platoon:
    """Drives vehicles that follow each other by the intelligent driver model.

    Args:
        position: `[vehicles]`, centre along the road, m.
        speed: `[vehicles]`, m/s.
        leader: `[vehicles]`, index of the vehicle ahead; -1 for one that follows nobody, which keeps its speed.
        driver: how they are driven.
        length: `[vehicles]`, m.
        habit: `[vehicles]`, acceleration beyond what the rule gives, m/s²; it dies away.
        dt: step, s.
        steps: how many.
        decay: time in which a habit falls to 1/e, s; 0: no habits.

    Raises:
        gnp.ForceError: for a number out of its range, a leader that is not there, or vehicles in a circle.
    """
    leaders = np.atleast_1d(np.asarray(leader, dtype=np.int64))
    columns = (position, speed, length, habit, *driver._columns())
    arrays = [
        np.ascontiguousarray(np.broadcast_to(np.asarray(column, dtype=np.float64), leaders.shape)) for column in columns
    ]
    outs = [np.empty((leaders.size, steps), dtype=np.float64) for _ in range(5)]
    _force.platoon(arrays, leaders.tolist(), dt, steps, decay, [out.reshape(-1) for out in outs])
    return Platoon(*outs)


def terms() -> list[dict[str, Any]]:
    """The terms of the force as figures name them: name, label, meaning, unit, colour, and parameters with their units."""
    described: list[dict[str, Any]] = _force.describe()
    return described
