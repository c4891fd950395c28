"""Vehicles detected 25 times a second, predicted as they come: how long a frame takes.

    python stream.py --vehicles 20 --seconds 10

The vehicles are simulated: they drive at constant speeds in three lanes.
"""

import argparse
import time

import numpy as np

import gnp
from gnp.online import Stream

parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
parser.add_argument("--vehicles", type=int, default=20)
parser.add_argument("--seconds", type=float, default=10.0)
arguments = parser.parse_args()

numbers = np.arange(arguments.vehicles)
lane, place = numbers % 3, numbers // 3
speed = 25.0 + 3.0 * lane
stream = Stream(gnp.load(), lines=[-1.85, 1.85, 5.55, 9.25])
took = []
for moment in np.arange(0.0, arguments.seconds, 0.04):
    frame = {
        "id": numbers,
        "x": 60.0 * place + speed * moment,
        "y": 3.7 * lane,
        "vx": speed,
        "vy": np.zeros(numbers.size),
    }
    start = time.perf_counter()
    forecasts = stream.push(float(moment), frame)
    paths = forecasts.paths  # [vehicles, futures, steps, (x, y)]
    took.append(1000 * (time.perf_counter() - start))
print(f"{forecasts}; {forecasts.validity.count('full')} with a full past")
print(f"median {np.median(took):.1f} ms a frame, 99 of 100 within {np.percentile(took, 99):.1f} ms")
