"""Checks that a table made on a local Ray cluster which loses a worker is the one that a single machine makes.

    python check.py --gnp target/release/gnp            seconds: small networks on two scenes
    python check.py --gnp target/release/gnp --full     two folds, two seeds, every network

A worker is killed, with the training that it runs, as soon as its first job has begun.
"""

import argparse
import contextlib
import glob
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
FILES = ["table1.md", "table1.csv", "table1.json", "differences.json"]
SHORT = {"steps": 2, "networks": 1, "epochs": 1}


def recipes(path, full):
    """The recipes of the project, each over in a moment."""
    tables = tomllib.loads((ROOT / "configs/neural-baselines.toml").read_text())
    kept = {stem: table for stem, table in tables.items() if full or stem in ("shared", "column_network", "s_lstm")}
    lines = []
    for stem, table in kept.items():
        lines.append(f"[{stem}]")
        for key, value in table.items():
            value = SHORT.get(key, value)
            text = str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')
            if isinstance(value, dict):
                text = "{" + ", ".join(f"{k} = {v!r}".replace("'", '"') for k, v in value.items()) + "}"
            lines.append(f"{key} = {text}")
    path.write_text("\n".join(lines) + "\n")


def training_process(out):
    """A running `gnp compare --job` of this folder and the worker above it."""
    for entry in glob.glob("/proc/[0-9]*"):
        try:
            words = pathlib.Path(entry, "cmdline").read_bytes().decode().split("\0")
            if "--job" not in words or str(out) not in words:
                continue
            stat = pathlib.Path(entry, "stat").read_text()
        except (OSError, UnicodeDecodeError):
            continue
        return int(entry.rsplit("/", 1)[1]), int(stat.rsplit(")", 1)[1].split()[1]), words[words.index("--job") + 1]
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gnp", required=True, help="the program")
    parser.add_argument("--full", action="store_true", help="two folds, two seeds, every network")
    arguments = parser.parse_args()
    program = str(pathlib.Path(arguments.gnp).resolve())
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        data = folder / "data"
        data.mkdir()
        for scene in ("us101-13_1", "us101-24_1"):
            shutil.copy(ROOT / f"fixtures/ngsim/{scene}.csv.gz", data)
        recipes(folder / "recipes.toml", arguments.full)
        options = ["--config", ROOT / "configs/smoke.toml", "--data-dir", data, "--recipes", folder / "recipes.toml"]
        options += ["--seeds", "2", "--set", "split.folds=2"] if arguments.full else ["--set", "goal.epochs=60"]
        here, there = folder / "here", folder / "there"
        subprocess.run([program, "compare", "--quiet", *options, "--out", here], check=True, stdout=subprocess.DEVNULL)

        subprocess.run([program, "compare", "--quiet", *options, "--out", there, "--plan"], check=True)
        cluster = [sys.executable, "-B", HERE / "ray_compare.py", "--gnp", program, "--out", there]
        driver = subprocess.Popen(cluster, stdout=subprocess.PIPE, text=True)
        killed = None
        try:
            while killed is None and driver.poll() is None:
                found = training_process(there)
                # Other jobs are over in a moment here.
                if found and "/gnp/" in found[2]:
                    training, worker, killed = found
                    os.kill(worker, signal.SIGKILL)
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(training, signal.SIGKILL)
                time.sleep(0.02)
            text, _ = driver.communicate()
        finally:
            driver.kill()
        sys.stdout.write("".join(line + "\n" for line in text.splitlines() if " jobs to do" in line or " done by " in line))
        if driver.returncode or killed is None:
            sys.exit(f"the cluster failed ({driver.returncode}), killed: {killed}")
        if f"{killed} done by process" not in text or f"{killed} done by process {worker}," in text:
            sys.exit(f"{killed} was not done by another worker than {worker}, which was killed")
        different = [name for name in FILES if (here / name).read_bytes() != (there / name).read_bytes()]
        if different:
            sys.exit(f"not the table of one machine: {', '.join(different)}")
        print(f"killed worker {worker} in {killed}; {', '.join(FILES)} are those of one machine")


if __name__ == "__main__":
    main()
