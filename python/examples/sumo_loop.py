"""Forecasts of simulated traffic, and what the simulation then did.

    pip install gnp[pyarrow] eclipse-sumo
    python sumo_loop.py                         five minutes of a motorway that loses a lane
    python sumo_loop.py --seconds 120 --every 30 --out loop

SUMO drives a motorway of three lanes of which the right one ends, and writes what a camera over the last 1500 m would see
(floating car data, FCD). Every `--every` seconds the last four seconds are cut out, so that nothing of what follows can
be known, and handed to `gnp predict`. What it forecasts is then held against what SUMO did, beside constant velocity.

The traffic is SIMULATED. How well a model trained on real drivers predicts SUMO's says something about both.
"""

import argparse
import json
import math
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET

LENGTH, LANES, LANE_WIDTH = 1500, 3, 3.75
LENGTHS = {"car": 4.6, "truck": 14.0}
STEP_S, PAST_S, WARM_UP_S = 0.1, 4.0, 60.0
HORIZONS_S = (1, 2, 3, 4, 5)

NODES = f'<nodes><node id="begin" x="0" y="0"/><node id="drop" x="{LENGTH}" y="0" radius="0"/><node id="end" x="3000" y="0"/></nodes>'
EDGES = f"""<edges>
<edge id="seen" from="begin" to="drop" numLanes="{LANES}" speed="33.3" width="{LANE_WIDTH}"/>
<edge id="beyond" from="drop" to="end" numLanes="{LANES - 1}" speed="33.3" width="{LANE_WIDTH}"/>
</edges>"""
CONNECTIONS = "<connections>{}</connections>".format(
    "".join(f'<connection from="seen" to="beyond" fromLane="{lane}" toLane="{lane - 1}"/>' for lane in range(1, LANES))
)
TYPES = f"""<additional>
<vTypeDistribution id="traffic">
<vType id="car" probability="0.85" length="{LENGTHS["car"]}" width="1.9" carFollowModel="EIDM" maxSpeed="40" speedFactor="normc(1,0.1,0.7,1.3)"/>
<vType id="truck" probability="0.15" length="{LENGTHS["truck"]}" width="2.5" vClass="truck" carFollowModel="EIDM" maxSpeed="24.5" speedFactor="normc(1,0.05,0.9,1.1)"/>
</vTypeDistribution>
</additional>"""
ROUTES = """<routes>
<route id="through" edges="seen beyond"/>
<flow id="v" type="traffic" route="through" begin="0" end="36000" period="exp({flow})" departLane="random" departSpeed="desired"/>
</routes>"""


def program(name):
    """A program of SUMO: where programs are sought, or where pip put it."""
    found = shutil.which(name) or shutil.which(name, path=os.path.dirname(sys.executable))
    return found or sys.exit(f"there is no {name}: pip install eclipse-sumo")


def simulate(folder, seconds, flow, seed):
    """Drives; the path of the floating car data."""
    files = {"n.nod.xml": NODES, "n.edg.xml": EDGES, "n.con.xml": CONNECTIONS, "types.add.xml": TYPES}
    files["routes.xml"] = ROUTES.format(flow=flow)
    files["seen.txt"] = "edge:seen"
    for name, text in files.items():
        (folder / name).write_text(text)
    net = [program("netconvert"), "-n", "n.nod.xml", "-e", "n.edg.xml", "-x", "n.con.xml", "-o", "net.xml"]
    net += ["--no-internal-links", "--no-turnarounds"]
    sumo = [program("sumo"), "-n", "net.xml", "-r", "routes.xml", "-a", "types.add.xml"]
    sumo += ["--step-length", str(STEP_S), "--end", str(seconds)]
    sumo += ["--seed", str(seed), "--no-step-log", "--precision", "4"]
    # Otherwise vehicles jump from lane to lane within one step.
    sumo += ["--lanechange.duration", "4"]
    sumo += ["--fcd-output", "fcd.xml", "--fcd-output.filter-edges.input-file", "seen.txt"]
    for command in (net, sumo):
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return folder / "fcd.xml"


def steps(path):
    """The time steps of floating car data, one after the other: time and the `vehicle` elements' attributes."""
    for _, element in ET.iterparse(path):
        if element.tag == "timestep":
            yield round(float(element.get("time")), 3), [dict(vehicle.attrib) for vehicle in element]
            element.clear()


def centre(vehicle):
    """Centre of a vehicle, of which SUMO tells the middle of the front, and its velocity; angles are clockwise from north."""
    angle, half = math.radians(float(vehicle["angle"])), LENGTHS[vehicle["type"]] / 2
    ahead, speed = (math.sin(angle), math.cos(angle)), float(vehicle["speed"])
    x, y = float(vehicle["x"]), float(vehicle["y"])
    return (x - half * ahead[0], y - half * ahead[1]), (speed * ahead[0], speed * ahead[1])


def write_fcd(path, parts):
    root = ET.Element("fcd-export")
    for time, vehicles in parts:
        step = ET.SubElement(root, "timestep", time=f"{time:.2f}")
        for vehicle in vehicles:
            ET.SubElement(step, "vehicle", vehicle)
    ET.ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True)


def cut(fcd, folder, every):
    """Writes what was seen up to each asked time; these times, and where every vehicle was at every time."""
    folder.mkdir()
    # Tells the lengths of vehicles: floating car data has their fronts alone.
    (folder / "types.add.xml").write_text(TYPES)
    asked, recent, truth = [], [], {}
    for time, vehicles in steps(fcd):
        recent = [part for part in recent if part[0] > time - PAST_S] + [(time, vehicles)]
        truth[time] = {vehicle["id"]: centre(vehicle) for vehicle in vehicles}
        if time >= WARM_UP_S and math.isclose(time % every, 0, abs_tol=1e-6):
            write_fcd(folder / f"until-{time:06.1f}.xml", recent)
            asked.append(time)
    return asked, truth


def score(forecasts, truth):
    """Root mean square errors by horizon, m: of the prediction, of the best of all paths, of constant velocity."""
    import pyarrow.parquet as parquet

    squares = {name: {h: [] for h in HORIZONS_S} for name in ("prediction", "best path", "constant velocity")}
    for file in sorted(forecasts.glob("*.parquet")):
        best = {}
        columns = ["vehicle_name", "time_s", "mode", "horizon_s", "x", "y"]
        for row in parquet.read_table(file, columns=columns).to_pylist():
            horizon, now = round(row["horizon_s"], 3), round(row["time_s"], 3)
            if horizon not in HORIZONS_S:
                continue
            then = truth.get(round(now + horizon, 3), {}).get(row["vehicle_name"])
            if then is None:  # it has left the section
                continue
            square = (row["x"] - then[0][0]) ** 2 + (row["y"] - then[0][1]) ** 2
            key = (row["vehicle_name"], now, int(horizon))
            best[key] = min(best.get(key, math.inf), square)
            if row["mode"] == 0:
                squares["prediction"][int(horizon)].append(square)
                (x, y), (vx, vy) = truth[now][row["vehicle_name"]]
                free = (x + vx * horizon - then[0][0]) ** 2 + (y + vy * horizon - then[0][1]) ** 2
                squares["constant velocity"][int(horizon)].append(free)
        for (_, _, horizon), square in best.items():
            squares["best path"][horizon].append(square)
    return {
        name: {h: (math.sqrt(sum(of) / len(of)), len(of)) for h, of in by.items() if of} for name, by in squares.items()
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gnp", default="gnp", help="the program, such as 'cargo xtask'")
    parser.add_argument("--model", help="of `gnp predict`; without it the model that comes with the program")
    parser.add_argument("--out", default="sumo-loop", help="folder, made anew")
    parser.add_argument("--seconds", type=float, default=300, help="of traffic")
    parser.add_argument("--every", type=float, default=10, help="seconds from one forecast to the next")
    parser.add_argument("--flow", type=float, default=1.6, help="vehicles a second that want to enter, on average")
    parser.add_argument("--seed", type=int, default=1, help="of the traffic")
    arguments = parser.parse_args()
    folder = pathlib.Path(arguments.out)
    folder.mkdir(parents=True)
    fcd = simulate(folder, arguments.seconds, arguments.flow, arguments.seed)
    asked, truth = cut(fcd, folder / "seen", arguments.every)
    command = [*shlex.split(arguments.gnp), "predict", "--input", folder / "seen", "--format", "sumo", "--at", "last"]
    command += ["--output", folder / "forecasts"]
    if arguments.model:
        command += ["--model", arguments.model]
    subprocess.run([os.fspath(word) for word in command], check=True)
    scores = score(folder / "forecasts", truth)
    print(f"SIMULATED traffic, {len(asked)} times, errors in m (root mean square):")
    print("horizon, s         " + "".join(f"{h:>8}" for h in HORIZONS_S))
    for name, by in scores.items():
        print(f"{name:<19}" + "".join(f"{by[h][0]:8.2f}" for h in HORIZONS_S if h in by))
    counted = scores["prediction"]
    print(f"{'forecasts scored':<19}" + "".join(f"{counted[h][1]:8}" for h in HORIZONS_S if h in counted))
    (folder / "scores.json").write_text(json.dumps(scores, indent=1))


if __name__ == "__main__":
    main()
