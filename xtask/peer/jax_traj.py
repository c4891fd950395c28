"""The neural social force of torch_gnp.py in JAX, compiled as a whole: `jit` over `scan`.

    python jax_traj.py --threads 2      milliseconds per window at the published sizes, as one JSON line
    python jax_traj.py --device cuda    milliseconds per batch and MiB on a GPU, a JSON line a case
"""
import argparse
import json
import os
import statistics
import time

BEGUN = time.perf_counter()
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--threads", type=int, default=2)
parser.add_argument("--windows", type=int, default=64)
parser.add_argument("--repeats", type=int, default=7)
parser.add_argument("--device", default="cpu", help="with cuda: milliseconds per batch and MiB for each of --batches")
parser.add_argument("--batches", default="64,1024,4096,256", help="windows in a batch, with --device cuda")
parser.add_argument("--case-seconds", type=float, default=0.25, help="time for the repeats of a case, with --device cuda")
parser.add_argument("--seconds", type=float, default=40, help="after which no case begins, with --device cuda")
ARGS = parser.parse_args()
ON_GPU = ARGS.device != "cpu"
os.environ.setdefault("JAX_PLATFORMS", ARGS.device)
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
if hasattr(os, "sched_setaffinity") and not ON_GPU:
    # The number of threads is read from the cores of the process when jax is loaded.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: ARGS.threads])

import jax
import jax.numpy as jnp

# Full f32 in products, as everybody else here; JAX takes TF32 on a GPU unless told.
jax.config.update("jax_default_matmul_precision", "float32")
SLOTS = 8
PRESENT = 0.65
# Observed steps, predicted steps, frame period in s.
LENGTHS = {"ngsim": (30, 50, 0.1), "highd": (75, 125, 0.04)}
KEYS = iter(jax.random.split(jax.random.PRNGKey(0), 400))


def linear(inputs, outputs):
    return jax.random.uniform(next(KEYS), (inputs, outputs), minval=-1, maxval=1) / inputs**0.5, jnp.zeros(outputs)


def dense(*widths):
    return [linear(widths[i], widths[i + 1]) for i in range(len(widths) - 1)]


def apply(layer, x):
    return x @ layer[0] + layer[1]


def apply_dense(layers, x):
    for layer in layers[:-1]:
        x = jax.nn.relu(apply(layer, x))
    return apply(layers[-1], x)


def weights(hidden=256, embedding=64, code=16, encoder=(64, 256), decoder=(512, 256, 512)):
    def front():
        return dict(
            emb=linear(4, embedding),
            cell=(linear(embedding, 4 * hidden), linear(hidden, 4 * hidden)),
            out=linear(hidden, code),
        )

    return dict(
        fronts=(front(), front()),
        enc_goal=dense(2, *encoder, code),
        enc_nei=dense(4, *encoder, code),
        tau=dense(2 * code, *decoder, 1),
        k=dense(2 * code, *decoder, 1),
    )


def advance(front, state, memory):
    h, c = memory
    x = jax.nn.relu(apply(front["emb"], state))
    i, f, g, o = jnp.split(apply(front["cell"][0], x) + apply(front["cell"][1], h), 4, -1)
    c = jax.nn.sigmoid(f) * c + jax.nn.sigmoid(i) * jnp.tanh(g)
    return jax.nn.sigmoid(o) * jnp.tanh(c), c


def roll_out(w, obs, goal, nei, mask, dt, k_max=100.0, r_col=26.0):
    """obs [B, To, 4], goal [B, 2], nei [B, Tp, N, 4], mask [B, N] -> positions [B, Tp, 2]."""
    batch, steps = obs.shape[0], nei.shape[1]
    hidden = w["fronts"][0]["cell"][1][0].shape[0]

    def fronts(memories, state):
        return tuple(advance(front, state, memory) for front, memory in zip(w["fronts"], memories))

    empty = ((jnp.zeros((batch, hidden)),) * 2,) * 2
    memories, _ = jax.lax.scan(lambda m, state: (fronts(m, state), None), empty, jnp.swapaxes(obs, 0, 1)[:-1])
    goal_code = apply_dense(w["enc_goal"], goal)

    def step(carry, given):
        memories, p, v = carry
        others, left = given
        memories = fronts(memories, jnp.concatenate((p, v), -1))
        code1, code2 = (apply(front["out"], memory[0]) for front, memory in zip(w["fronts"], memories))
        tau = jax.nn.sigmoid(apply_dense(w["tau"], jnp.concatenate((code1, goal_code), -1))) + dt
        force = ((goal - p) / (left * dt) - v) / tau
        code2 = jnp.broadcast_to(code2[:, None], (*others.shape[:2], code2.shape[-1]))
        pairs = jnp.concatenate((code2, apply_dense(w["enc_nei"], others)), -1)
        k = k_max * jax.nn.sigmoid(apply_dense(w["k"], pairs))[..., 0] * mask
        away = p[:, None] - others[..., :2]
        distance = jnp.sqrt((away**2).sum(-1) + 1e-8)
        force = force + ((k * jnp.exp(-distance / r_col) / distance)[..., None] * away).sum(1)
        v = v + dt * force
        p = p + dt * v
        return (memories, p, v), p

    start = (memories, obs[:, -1, :2], obs[:, -1, 2:])
    _, path = jax.lax.scan(step, start, (jnp.swapaxes(nei, 0, 1), jnp.arange(steps, 0, -1.0)))
    return jnp.swapaxes(path, 0, 1)


def timed(run):
    """Median seconds of `run`, after one that compiles and does not count."""
    jax.block_until_ready(run())
    seconds = []
    for _ in range(ARGS.repeats):
        start = time.perf_counter()
        jax.block_until_ready(run())
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def cases(w, windows, observed, predicted, dt):
    """What is timed: the path, and value and gradient of a loss of it."""

    def normal(*shape):
        return jax.random.normal(next(KEYS), shape)

    obs, goal = normal(windows, observed, 4), normal(windows, 2) + 100
    nei, truth = normal(windows, predicted, SLOTS, 4) * 10, normal(windows, predicted, 2)
    mask = (jax.random.uniform(next(KEYS), (windows, SLOTS)) < PRESENT) * 1.0
    # Given and not captured: constants would be folded while it is compiled.
    given = obs, goal, nei, mask
    forward = jax.jit(lambda w, given: roll_out(w, *given, dt))
    train = jax.jit(jax.value_and_grad(lambda w, given, truth: ((roll_out(w, *given, dt) - truth) ** 2).mean()))
    return {"traj.forward": lambda: forward(w, given), "traj.train": lambda: train(w, given, truth)}


def on_gpu(run):
    """Milliseconds of `run`, and MiB of all that JAX held at most so far; neither when it lacks memory."""

    def once():
        start = time.perf_counter()
        jax.block_until_ready(run())
        return time.perf_counter() - start

    try:
        once(), once()
        begun, seconds = time.perf_counter(), []
        while len(seconds) < 3 or time.perf_counter() - begun < ARGS.case_seconds:
            seconds.append(once())
    except Exception as error:
        if "RESOURCE_EXHAUSTED" not in str(error):
            raise
        return {"ms": None, "mib": None}
    stats = jax.devices()[0].memory_stats() or {}
    peak = stats.get("peak_bytes_in_use")
    return {"ms": round(statistics.median(seconds) * 1e3, 4), "mib": peak and round(peak / 2**20, 1)}


def bench_gpu():
    """Prints each case as a JSON line when it is measured, the first batches first."""
    w = weights()
    for name, (observed, predicted, dt) in LENGTHS.items():
        for windows in map(int, ARGS.batches.split(",")):
            runs = cases(w, windows, observed, predicted, dt)
            for key in ("traj.train", "traj.forward"):
                if time.perf_counter() - BEGUN < ARGS.seconds:
                    print(json.dumps({f"{name}.{key}@{windows}": on_gpu(runs[key])}), flush=True)


def main():
    w, windows, milliseconds = weights(), ARGS.windows, {}
    for name, (observed, predicted, dt) in LENGTHS.items():
        for key, run in cases(w, windows, observed, predicted, dt).items():
            milliseconds[f"{name}.{key}"] = timed(run) / windows * 1e3
    print(json.dumps({key: round(value, 4) for key, value in milliseconds.items()}))


if __name__ == "__main__":
    bench_gpu() if ON_GPU else main()
