"""The table of all systems, trained job by job on a Ray cluster.

    gnp compare --dataset ngsim --seeds 3 --out T --plan     once: prepares T
    python ray_compare.py --gnp gnp --out T                  here, on two workers of one core each
    python ray_compare.py --gnp gnp --out T --address auto   on the cluster that this machine is part of

Every node must see the folder T under the same path and have the program. A job whose worker dies is started again
elsewhere and goes on from its last checkpoint; one that is done is not done again.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys


def gnp(program, out, *arguments, **options):
    """Runs one step of the comparison in the folder `out`."""
    return subprocess.run([program, "compare", "--out", out, *arguments], check=True, **options)


def train(program, out, job):
    """Trains one job on one core; returns its name and the process that did it."""
    # candle has threads of its own, as many as this says.
    one = {**os.environ, "RAYON_NUM_THREADS": "1"}
    command = [program, "compare", "--out", out, "--quiet", "--threads", "1", "--job", job]
    done = subprocess.run(command, env=one, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr.strip() or f"ended with {done.returncode}")
    return job, os.getpid()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gnp", default="gnp", help="the program")
    parser.add_argument("--out", required=True, help="the prepared folder")
    parser.add_argument("--address", help="of a running cluster; without it a local one is started")
    parser.add_argument("--workers", type=int, default=2, help="of the local cluster")
    parser.add_argument("--retries", type=int, default=3, help="of a job whose worker dies")
    arguments = parser.parse_args()
    # A worker's current folder is another one.
    arguments.gnp = os.path.abspath(shutil.which(arguments.gnp) or arguments.gnp)
    arguments.out = os.path.abspath(arguments.out)

    listed = gnp(arguments.gnp, arguments.out, "--quiet", "--plan", "--json", stdout=subprocess.PIPE, text=True)
    jobs = json.loads(listed.stdout)["jobs"]
    left = [job["id"] for job in jobs if job["state"] != "done"]
    print(f"{len(left)} of {len(jobs)} jobs to do", flush=True)

    import ray

    if arguments.address:
        ray.init(address=arguments.address, log_to_driver=False)
    else:
        ray.init(num_cpus=arguments.workers, include_dashboard=False, log_to_driver=False)
    task = ray.remote(num_cpus=1, max_retries=arguments.retries)(train)
    names = {task.remote(arguments.gnp, arguments.out, job): job for job in left}
    failed = []
    waiting = list(names)
    while waiting:
        ready, waiting = ray.wait(waiting, num_returns=1)
        try:
            job, process = ray.get(ready[0])
            print(f"{job} done by process {process}, {len(left) - len(waiting)} of {len(left)}", flush=True)
        except ray.exceptions.RayError as error:
            failed.append(names[ready[0]])
            print(f"{names[ready[0]]} failed: {error}", file=sys.stderr, flush=True)
    ray.shutdown()
    if failed:
        sys.exit(f"{len(failed)} jobs failed: {', '.join(failed)}; start this program again to go on")
    gnp(arguments.gnp, arguments.out, "--gather")


if __name__ == "__main__":
    main()
