"""Straight roads for SUMO: what sumo_speed.py and sumo_replay.py have in common.

Needs `eclipse-sumo` and `libsumo` of the same version from PyPI (1.28.0 was used).
"""
import os
import shutil
import subprocess
import xml.etree.ElementTree as ET

# No file, no message, no teleport: vehicles stay where their model puts them. A collision is an overlap of two boxes.
QUIET = (
    "--no-step-log", "--duration-log.disable", "--no-warnings", "--threads", "1", "--time-to-teleport", "-1",
    "--collision.action", "warn", "--collision.mingap-factor", "0",
)  # fmt: skip


def netconvert():
    """The program's path: beside the package `eclipse-sumo`, or on the path."""
    try:
        import sumo

        inside = os.path.join(sumo.SUMO_HOME, "bin", "netconvert")
    except ImportError:
        inside = None
    found = shutil.which(inside) if inside else shutil.which("netconvert")
    if not found:
        raise SystemExit("netconvert is missing: pip install eclipse-sumo")
    return found


def write(path, root):
    ET.ElementTree(root).write(path)
    return path


def road_net(folder, roads, speed_limit):
    """Writes a net of parallel straight roads and returns its path.

    `roads` is a list of `(name, y, lane widths from the right, ends of the edges)`; `y` is the right border in m, growing to
    the left. A road begins at x = 0; edge number i of road `name` is `name.i`. `speed_limit` in m/s.
    """
    nodes, edges = ET.Element("nodes"), ET.Element("edges")
    for name, y, widths, ends in roads:
        # With `spreadType` right the lanes lie to the right of the line between the nodes.
        left = y + sum(widths)
        for i, x in enumerate((0.0, *ends)):
            ET.SubElement(nodes, "node", id=f"{name}.{i}", x=f"{x:.6f}", y=f"{left:.6f}")
        for i in range(len(ends)):
            edge = ET.SubElement(
                edges, "edge", {"id": f"{name}.{i}", "from": f"{name}.{i}", "to": f"{name}.{i + 1}"},
                numLanes=str(len(widths)), speed=f"{speed_limit:.6f}", spreadType="right",
            )  # fmt: skip
            for index, width in enumerate(widths):
                ET.SubElement(edge, "lane", index=str(index), width=f"{width:.6f}")
    files = [write(os.path.join(folder, "plain.nod.xml"), nodes), write(os.path.join(folder, "plain.edg.xml"), edges)]
    net = os.path.join(folder, "road.net.xml")
    command = [netconvert(), "-n", files[0], "-e", files[1], "-o", net, "--offset.disable-normalization", "true"]
    # Edges that follow each other touch: no inner lanes, no turn-arounds.
    command += ["--no-internal-links", "true", "--no-turnarounds", "true", "--precision", "6"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"netconvert failed:\n{done.stderr}")
    return net
