"""How fast SUMO steps a motorway with the IDM: the scene of gnp-force's benchmark `simulator`.

    python sumo_speed.py --vehicles 10000 --seconds 10             lane changes off
    python sumo_speed.py --vehicles 10000 --seconds 10 --lane-changes

Three lanes of 3.75 m, a vehicle every 30 m and lane, every other one on the right lane a lorry. After 10 s that do not count,
`--seconds` of traffic are timed: one call of `libsumo.simulation.step(until)`, so that no Python and no file is in the
figure. Without lane changes every lane is a road of its own, so that SUMO does not even look for them. One thread. Every run
starts anew in a process of its own and prints a line; the last line is JSON. Shorter edges, as real nets have them, cost SUMO
more (`--edge 500`).

Needs `eclipse-sumo` and `libsumo` of the same version from PyPI (1.28.0 was used).
"""
import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET

from sumo_scene import QUIET, road_net, write

LANES, WIDTH, SPACING, WARM_UP = 3, 3.75, 30.0, 10.0
# SUMO's own defaults of the IDM for passenger cars.
IDM = {"carFollowModel": "IDM", "accel": "2.6", "decel": "4.5", "tau": "1", "minGap": "2.5"}
LIMIT = 50.0


def scene(folder, arguments):
    """Net and routes; the order of the routes is the one in which SUMO puts vehicles onto the road."""
    rows = math.ceil(arguments.vehicles / LANES)
    length = rows * SPACING + 40.0 * (WARM_UP + arguments.seconds) + 500.0
    pieces = max(1, round(length / arguments.edge)) if arguments.edge else 1
    ends = [length * (i + 1) / pieces for i in range(pieces)]
    if arguments.lane_changes:
        roads = [("motorway", 0.0, [WIDTH] * LANES, ends)]
    else:
        roads = [(f"lane{lane}", lane * WIDTH, [WIDTH], ends) for lane in range(LANES)]
    net, root, kinds = road_net(folder, roads, LIMIT), ET.Element("routes"), {}
    vehicles = []
    for i in range(arguments.vehicles):
        lane, x = i % LANES, i // LANES * SPACING
        lorry = lane == 0 and i % 2 == 0
        speed = 23.0 if lorry else 28.0 + 3.0 * lane + i % 7 * 0.3
        kind = f"{'lorry' if lorry else 'car'}{speed:.1f}"
        size = {"length": "16.5", "width": "2.5"} if lorry else {"length": "4.6", "width": "1.9"}
        kinds[kind] = {"id": kind, "maxSpeed": f"{speed:.1f}", "speedFactor": "1", "speedDev": "0", **size, **IDM}
        # SUMO says where the front is; the road begins half a lorry before the first centre.
        front = x + float(size["length"]) / 2 + 10.0
        piece = min(int(front / (length / pieces)), pieces - 1)
        vehicles.append((i, kind, lane, speed, piece, front - piece * length / pieces))
    for kind in kinds.values():
        ET.SubElement(root, "vType", kind)
    for i, kind, lane, speed, piece, position in vehicles:
        road = roads[0 if arguments.lane_changes else lane][0]
        vehicle = ET.SubElement(
            root, "vehicle", id=str(i), type=kind, depart="0", departLane=str(lane if arguments.lane_changes else 0),
            departPos=f"{position:.3f}", departSpeed=f"{speed:.1f}", insertionChecks="none",
        )  # fmt: skip
        ET.SubElement(vehicle, "route", edges=" ".join(f"{road}.{k}" for k in range(piece, pieces)))
    return net, write(os.path.join(folder, "traffic.rou.xml"), root)


def run(arguments):
    """Seconds of the timed part and what happened on the way."""
    import libsumo

    with tempfile.TemporaryDirectory() as folder:
        net, routes = scene(folder, arguments)
        started = time.perf_counter()
        libsumo.start(["sumo", "-n", net, "-r", routes, "--step-length", str(arguments.step), *QUIET])
    try:
        libsumo.simulation.step()
        inserted, inserting = libsumo.vehicle.getIDCount(), time.perf_counter() - started
        if inserted != arguments.vehicles:
            raise SystemExit(f"{inserted} of {arguments.vehicles} vehicles were inserted")
        collided = set()
        for _ in range(1, round(WARM_UP / arguments.step)):
            libsumo.simulation.step()
            collided.update(collision.collider for collision in libsumo.simulation.getCollisions())
        begin = libsumo.simulation.getTime()
        lanes = {i: libsumo.vehicle.getLaneIndex(i) for i in libsumo.vehicle.getIDList()}
        started = time.perf_counter()
        libsumo.simulation.step(begin + arguments.seconds)
        seconds = time.perf_counter() - started
        steps = round((libsumo.simulation.getTime() - begin) / arguments.step)
        left = libsumo.vehicle.getIDCount()
        if left != arguments.vehicles or libsumo.simulation.getStartingTeleportNumber():
            raise SystemExit(f"{left} of {arguments.vehicles} vehicles are left at the end")
        speeds = [libsumo.vehicle.getSpeed(i) for i in lanes]
        changed = sum(libsumo.vehicle.getLaneIndex(i) != lane for i, lane in lanes.items())
    finally:
        libsumo.close()
    return {
        "seconds": seconds, "steps": steps, "inserting_s": inserting, "collided_in_warm_up": len(collided),
        "in_another_lane": changed, "mean_speed": statistics.fmean(speeds),
    }  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated and timed [10]")
    parser.add_argument("--step", type=float, default=0.04, help="s [0.04]")
    parser.add_argument("--lane-changes", action="store_true", help="one road of three lanes, SUMO's default lane changing")
    parser.add_argument("--edge", type=float, default=0.0, help="length of the edges of the net in m; 0: one edge [0]")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="only the last line")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(run(arguments)))
        return
    runs = []
    for _ in range(arguments.repeats):
        again = [sys.executable, "-B", os.path.abspath(__file__), *sys.argv[1:], "--one"]
        done = subprocess.run(again, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(done.stderr)
        runs.append(json.loads(done.stdout.splitlines()[-1]))
        if not arguments.json:
            print(runs[-1], flush=True)
    seconds = sorted(run["seconds"] for run in runs)
    steps, median = runs[0]["steps"], statistics.median(seconds)
    print(json.dumps({
        "vehicles": arguments.vehicles, "step_s": arguments.step, "steps": steps, "lane_changes": arguments.lane_changes,
        "edge_m": arguments.edge, "runs": len(runs), "min_s": seconds[0], "median_s": median,
        "vehicle_steps_per_s": arguments.vehicles * steps / median,
        "best_vehicle_steps_per_s": arguments.vehicles * steps / seconds[0],
        "times_real_time": steps * arguments.step / median,
        **{key: runs[0][key] for key in ("inserting_s", "collided_in_warm_up", "in_another_lane", "mean_speed")},
    }))  # fmt: skip


if __name__ == "__main__":
    main()
