"""Drives on from a moment of a recorded scene with SUMO, closed loop: what SUMO's IDM makes of the same start.

    python sumo_replay.py scene.json --out positions.csv.gz
    python sumo_replay.py scene.json --out positions.csv --drivers defaults --lane-changes on --seeds 1 2 3

Needs `eclipse-sumo` and `libsumo` of the same version from PyPI (1.28.0 was used).

The scene, JSON; x forward, y to the left, positions are centres of boxes; m, m/s, s; lane 0 is the rightmost:

    {"name": "us101-24_1",              optional, handed through
     "start": 3.0,                      optional, handed through: the moment in the recording that is 0 here
     "step": 0.1,                       whole milliseconds
     "duration": 10.0,                  states 0, 1, ... duration / step are written
     "road": {"lines": [-22.0, -18.3, ...],      borders of the lanes from right to left, one more than lanes
              "from": 0.0, "to": 300.0,          the section; see below
              "speed_limit": 29.1},
     "vehicles": [{"id": 7, "length": 4.5, "width": 1.8,
                   "enter": 0.0,                 0 for those present
                   "lane": 0, "x": 12.3, "y": -20.1, "speed": 14.0,     when it enters
                   "desired_speed": 18.0,        null: the limit times SUMO's speed factor, drawn for each vehicle and seed
                   "idm": {"accel": 1.2, "decel": 2.0, "tau": 1.1, "minGap": 2.0}}],      null: SUMO's defaults; `delta` as well
     "replayed": [{"id": 9, "length": 4.5, "width": 1.8, "enter": 0.0, "states": [[55.2, -20.0, 13.0], ...]}],
     "seeds": [1, 2],                   optional, [1]
     "lane_changes": false             optional; true: SUMO's defaults; an object: with these attributes of a vehicle type,
                                        {"lcOvertakeRight": 1, "lcKeepRight": 0} where the right lane is like the others}

Vehicles leave when their centre has passed `to`: they are not written any more, and drive on at the speed that they have there
for another 300 m, so that those behind follow somebody.

`replayed` vehicles move as recorded, a state (x, y, speed) a step from `enter` on, and are gone after the last; SUMO sees them
in the middle of their lane. Vehicles present at 0 are put where they are, whatever is near. Those that enter later wait until
no box is in their place; SUMO's own check would ask for `minGap` as well. Lane changes take `--lane-change-duration`. Without
sub-lanes SUMO knows only lanes: y is the middle of the lane, or with `--keep-offset` as far from it as the vehicle began.

`--out` gets the columns seed, step, id, x, y, speed, lane, driven (0: replayed); its name may end in `.gz`. Printed as JSON,
per seed: collisions as SUMO counts them (an overlap along one lane, of two vehicles one of which is driven; each pair once),
late insertions (seconds by id), vehicles that never came in, changes of lane.
"""
import argparse
import csv
import gzip
import json
import os
import tempfile
import time
import xml.etree.ElementTree as ET

import libsumo

from sumo_scene import QUIET, road_net, write

EAST = 90.0
# A vehicle that may not change lane would still mind those on its left, which SUMO by default does not pass on the right.
CAR_FOLLOWING_ONLY = {"lcOvertakeRight": 1, "lcCooperative": 0, "lcSpeedGain": 0, "lcKeepRight": 0}
# Road before the first and behind the last position of anybody, m.
MARGIN = 100.0
# Road beyond the section for those who have left it, m.
BEYOND = 300.0
# What SUMO takes where a vehicle type says nothing: m/s, m/s^2, m.
FASTEST, EMERGENCY, GAP = 200 / 3.6, 9.0, 2.5


class Scene:
    """The file, with places in SUMO's coordinates: the road begins at x = 0 with its right border at y = 0."""

    def __init__(self, data, fitted):
        self.step, self.fitted = data["step"], fitted
        self.steps = round(data["duration"] / self.step)
        road, self.driven = data["road"], data["vehicles"]
        self.replayed = {str(vehicle["id"]): vehicle for vehicle in data.get("replayed", [])}
        self.lines, self.limit, self.end = road["lines"], road["speed_limit"], road["to"]
        if self.lines != sorted(self.lines) or len(self.lines) < 2:
            raise SystemExit("road.lines must grow, from right to left, and be two or more")
        if abs(self.step * 1000 - round(self.step * 1000)) > 1e-6 or self.step <= 0:
            raise SystemExit("step must be a whole number of milliseconds")
        ids = [str(vehicle["id"]) for vehicle in self.driven] + list(self.replayed)
        if len(set(ids)) < len(ids):
            raise SystemExit("an id stands twice among vehicles and replayed")
        wrong = [vehicle["id"] for vehicle in self.driven if not 0 <= vehicle["lane"] < len(self.lines) - 1]
        wrong += [vehicle["id"] for vehicle in self.replayed.values() if not vehicle["states"]]
        if wrong:
            raise SystemExit(f"no such lane, or no state, for {wrong}")
        self.lengths = {str(v["id"]): v["length"] for v in (*self.driven, *self.replayed.values())}
        recorded = [state[0] for vehicle in self.replayed.values() for state in vehicle["states"]]
        placed = [vehicle["x"] for vehicle in self.driven]
        self.origin = min(road["from"], *recorded, *placed) - MARGIN
        self.length = max(self.end + BEYOND, *recorded, *placed) + MARGIN - self.origin
        self.due = {str(v["id"]): round(v["enter"] / self.step) for v in (*self.driven, *self.replayed.values())}
        self.speeds = {str(v["id"]): v["speed"] for v in self.driven}
        self.offsets = {str(v["id"]): v["y"] - self.middle(v["lane"]) for v in self.driven}
        self.gaps = {str(v["id"]): (v.get("idm") or {}).get("minGap", GAP) if fitted else GAP for v in self.driven}

    def lane_at(self, y):
        """Lane of a lateral position; the outermost one beside the road."""
        return sum(line <= y for line in self.lines[1:-1])

    def middle(self, lane):
        return (self.lines[lane] + self.lines[lane + 1]) / 2

    def front(self, vehicle, x):
        """SUMO's place of a box: its front."""
        return x + self.lengths[vehicle] / 2 - self.origin

    def files(self, folder, lane_changes):
        """Net and routes, with everybody's moment and place of entry."""
        widths = [left - right for right, left in zip(self.lines, self.lines[1:])]
        net, root = road_net(folder, [("road", 0.0, widths, [self.length])], self.limit), ET.Element("routes")
        ET.SubElement(root, "route", id="along", edges="road.0")
        attributes = lane_changes if isinstance(lane_changes, dict) else {} if lane_changes else CAR_FOLLOWING_ONLY
        for vehicle in self.driven:
            kind = {"carFollowModel": "IDM", **attributes}
            if self.fitted and vehicle.get("idm"):
                kind |= {"emergencyDecel": max(EMERGENCY, vehicle["idm"].get("decel", 0.0)), **vehicle["idm"]}
            if self.fitted and vehicle.get("desired_speed"):
                wish = vehicle["desired_speed"]
                kind |= {"speedFactor": wish / self.limit, "speedDev": 0, "maxSpeed": max(wish, FASTEST)}
            self.add(root, vehicle, kind, vehicle["lane"], vehicle["x"])
        for vehicle in self.replayed.values():
            x, y, _ = vehicle["states"][0]
            self.add(root, vehicle, {"maxSpeed": 100}, self.lane_at(y), x)
        root[:] = sorted(root, key=lambda element: float(element.get("depart", "-1")))
        return net, write(os.path.join(folder, "traffic.rou.xml"), root)

    def add(self, root, vehicle, kind, lane, x):
        name = str(vehicle["id"])
        # `minGap` and speed are set when the vehicle is there: SUMO would wait for the gap, and refuses a vehicle that is
        # faster than it wishes to be.
        kind = {"length": vehicle["length"], "width": vehicle["width"], **kind, "id": f"type.{name}", "minGap": 0}
        ET.SubElement(root, "vType", {key: str(value) for key, value in kind.items()})
        checks = "collision" if self.due[name] and name not in self.replayed else "none"
        ET.SubElement(
            root, "vehicle", id=name, type=f"type.{name}", route="along", depart=f"{self.due[name] * self.step:.3f}",
            departLane=str(lane), departPos=f"{self.front(name, x):.6f}", departSpeed="0", insertionChecks=checks,
        )  # fmt: skip

    def recorded(self, name, step):
        """State of a replayed vehicle; none once it is over."""
        states, k = self.replayed[name]["states"], step - self.due[name]
        return states[k] if k < len(states) else None

    def move(self, step):
        """Puts the replayed vehicles where they are at the end of this step; those that are over are taken away."""
        for name in self.replayed.keys() & set(libsumo.vehicle.getIDList()):
            state = self.recorded(name, step)
            if state is None:
                libsumo.vehicle.remove(name)
            else:
                lane = self.lane_at(state[1])
                at = self.front(name, state[0]), self.middle(lane) - self.lines[0]
                libsumo.vehicle.moveToXY(name, "road.0", lane, *at, EAST, 1)


def drive(scene, seed, lane_changes, keep_offset, writer):
    """One run from the files that libsumo has loaded; returns what happened."""
    collisions, late, lanes, changes, gone = set(), {}, {}, 0, set()
    for step in range(scene.steps + 1):
        scene.move(step)
        libsumo.simulation.step()
        for name in libsumo.simulation.getDepartedIDList():
            if name not in scene.replayed:
                libsumo.vehicle.setPreviousSpeed(name, scene.speeds[name], 0.0)
                libsumo.vehicle.setMinGap(name, scene.gaps[name])
            if not lane_changes or name in scene.replayed:
                libsumo.vehicle.setLaneChangeMode(name, 0)
            if step > scene.due[name]:
                late[name] = round((step - scene.due[name]) * scene.step, 3)
            lanes[name] = libsumo.vehicle.getLaneIndex(name)
        for collision in libsumo.simulation.getCollisions():
            pair = tuple(sorted((collision.collider, collision.victim)))
            if not all(name in scene.replayed or name in gone for name in pair):
                collisions.add(pair)
        for name in libsumo.vehicle.getIDList():
            lane, driven = libsumo.vehicle.getLaneIndex(name), name not in scene.replayed
            if driven:
                front, y = libsumo.vehicle.getPosition(name)
                x, speed = front + scene.origin - scene.lengths[name] / 2, libsumo.vehicle.getSpeed(name)
                y += scene.lines[0] + (scene.offsets[name] if keep_offset else 0.0)
                if x > scene.end:
                    if name not in gone:
                        gone.add(name)
                        libsumo.vehicle.setLaneChangeMode(name, 0)
                        libsumo.vehicle.setSpeedMode(name, 0)
                        libsumo.vehicle.setSpeed(name, speed)
                    continue
                changes += lane != lanes[name]
                lanes[name] = lane
            else:
                x, y, speed = scene.recorded(name, step)
                # SUMO bounds the speed that it finds from two places by what the vehicle can do.
                libsumo.vehicle.setPreviousSpeed(name, speed, 0.0)
            writer.writerow((seed, step, name, f"{x:.3f}", f"{y:.3f}", f"{speed:.3f}", lane, int(driven)))
    never = sorted(name for name, due in scene.due.items() if due <= scene.steps and name not in lanes)
    return {
        "seed": seed, "vehicles": len(lanes), "collisions": len(collisions), "collided": sorted(collisions),
        "late_s": late, "never_inserted": never, "lane_changes": changes,
    }  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--out", required=True, help="CSV of the positions")
    parser.add_argument("--drivers", choices=("fitted", "defaults"), default="fitted",
                        help="defaults: `idm` and `desired_speed` of the scene count nothing [fitted]")  # fmt: skip
    parser.add_argument("--lane-changes", choices=("on", "off"), help="instead of the scene's")
    parser.add_argument("--lane-change-duration", type=float, default=2.0, help="s [2]")
    parser.add_argument("--keep-offset", action="store_true", help="see above")
    parser.add_argument("--seeds", type=int, nargs="+", help="instead of the scene's")
    arguments = parser.parse_args()
    with open(arguments.scene, encoding="utf-8") as file:
        data = json.load(file)
    try:
        scene = Scene(data, arguments.drivers == "fitted")
    except KeyError as missing:
        raise SystemExit(f"{arguments.scene} lacks {missing}; see --help") from missing
    lane_changes = data.get("lane_changes", False)
    if arguments.lane_changes:
        lane_changes = arguments.lane_changes == "on" and (lane_changes or True)
    runs, started = [], time.perf_counter()
    opened = gzip.open if arguments.out.endswith(".gz") else open
    with tempfile.TemporaryDirectory() as folder, opened(arguments.out, "wt", newline="", encoding="utf-8") as out:
        net, routes = scene.files(folder, lane_changes)
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(("seed", "step", "id", "x", "y", "speed", "lane", "driven"))
        for seed in arguments.seeds or data.get("seeds", [1]):
            libsumo.start([
                "sumo", "-n", net, "-r", routes, "--step-length", str(scene.step), "--seed", str(seed),
                "--lanechange.duration", str(arguments.lane_change_duration),
                # One that waits for its place keeps nobody else waiting.
                "--eager-insert", *QUIET,
            ])  # fmt: skip
            runs.append(drive(scene, seed, lane_changes, arguments.keep_offset, writer))
            libsumo.close()
    print(json.dumps({
        "name": data.get("name"), "start": data.get("start"), "sumo": libsumo.getVersion()[1], "drivers": arguments.drivers,
        "lane_changes": lane_changes, "steps": scene.steps,
        "wall_s": round(time.perf_counter() - started, 3), "runs": runs,
    }))  # fmt: skip


if __name__ == "__main__":
    main()
