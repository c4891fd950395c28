"""Both networks of GNP in PyTorch, written as one would write them there: the measure of the project's speed and numbers.

    python torch_gnp.py bench --threads 2           milliseconds per window at the published sizes, as one JSON line
    python torch_gnp.py bench --device cuda         milliseconds per batch and MiB on a GPU, a JSON line a case
    python torch_gnp.py golden OUT.safetensors      random weights, inputs, outputs and gradients of small networks

`fixtures/golden.safetensors` was made by `golden`. Parameters have the names of the checkpoints.
"""
import argparse
import json
import statistics
import time

BEGUN = time.perf_counter()

import torch
from torch import nn
from torch.nn import functional as F

SLOTS = 8
PRESENT = 0.65
GOALS = 20
# Observed steps, predicted steps, intention modes, frame period in s.
LENGTHS = {"ngsim": (30, 50, 100, 0.1), "highd": (75, 125, 200, 0.04)}


class Attention(nn.Module):
    """Attention of `heads` heads; `mask` is 1 where a key exists."""

    def __init__(self, width, heads):
        super().__init__()
        self.q, self.k, self.v, self.o = (nn.Linear(width, width) for _ in range(4))
        self.heads = heads

    def forward(self, queries, keys, mask=None):
        def split(x):
            return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)

        exists = None if mask is None else mask[:, None, None, :].bool()
        y = F.scaled_dot_product_attention(split(self.q(queries)), split(self.k(keys)), split(self.v(keys)), exists)
        return self.o(y.transpose(1, 2).flatten(2))


class Block(nn.Module):
    """Attention, then two dense layers; each is added to its input and normalised."""

    def __init__(self, width, heads, factor):
        super().__init__()
        self.attn, self.n1, self.n2 = Attention(width, heads), nn.LayerNorm(width), nn.LayerNorm(width)
        self.f1, self.f2 = nn.Linear(width, factor * width), nn.Linear(factor * width, width)

    def forward(self, queries, keys, mask=None):
        x = self.n1(queries + self.attn(queries, keys, mask))
        return self.n2(x + self.f2(F.relu(self.f1(x))))


class GoalNet(nn.Module):
    """Modes as tokens: an encoder weighs them, a decoder looks at the neighbours."""

    def __init__(self, observed, predicted, width=64, layers=2, heads=4, factor=2):
        super().__init__()
        self.mode, self.obs, self.nei = (nn.Linear(n, width) for n in (2 * predicted, 4 * observed, 4 * observed))
        self.enc = nn.ModuleList(Block(width, heads, factor) for _ in range(layers))
        self.dec = Block(width, heads, factor)
        self.prob, self.goal = nn.Linear(width, 1), nn.Linear(width, 2 * predicted)

    def forward(self, obs, nei, mask, modes, pick):
        """obs [B, To, 4], nei [B, N, To, 4], mask [B, N], modes [L, Tp, 2], pick [B, K] -> logits [B, L], futures [B, K, Tp, 2]."""
        x = self.mode(modes.flatten(1))[None] + self.obs(obs.flatten(1))[:, None]
        for block in self.enc:
            x = block(x, x)
        logits = self.prob(x)[..., 0]
        picked = x.gather(1, pick[..., None].expand(-1, -1, x.shape[-1]))
        return logits, self.goal(self.dec(picked, self.nei(nei.flatten(2)), mask)).unflatten(-1, (-1, 2))


def dense(*widths):
    layers = []
    for i in range(len(widths) - 1):
        layers += [nn.Linear(widths[i], widths[i + 1]), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


class SocialForce(nn.Module):
    """LSTM fronts set tau and the neighbours' strengths; forces move the vehicle by semi-implicit Euler steps."""

    def __init__(self, hidden=256, embedding=64, code=16, encoder=(64, 256), decoder=(512, 256, 512), k_max=100.0, r_col=26.0):
        super().__init__()
        self.emb1, self.emb2 = nn.Linear(4, embedding), nn.Linear(4, embedding)
        self.cell1, self.cell2 = nn.LSTMCell(embedding, hidden), nn.LSTMCell(embedding, hidden)
        self.out1, self.out2 = nn.Linear(hidden, code), nn.Linear(hidden, code)
        self.enc_goal, self.enc_nei = dense(2, *encoder, code), dense(4, *encoder, code)
        self.tau, self.k = dense(2 * code, *decoder, 1), dense(2 * code, *decoder, 1)
        self.k_max, self.r_col = k_max, r_col

    def fronts(self, state, memory1, memory2):
        return self.cell1(F.relu(self.emb1(state)), memory1), self.cell2(F.relu(self.emb2(state)), memory2)

    def forward(self, obs, goal, nei, mask, dt):
        """obs [B, To, 4] as (p, v), goal [B, 2], nei [B, Tp, N, 4], mask [B, N] -> positions [B, Tp, 2]."""
        memory1 = memory2 = None
        for t in range(obs.shape[1]):
            memory1, memory2 = self.fronts(obs[:, t], memory1, memory2)
        p, v = obs[:, -1, :2], obs[:, -1, 2:]
        goal_code, steps, path = self.enc_goal(goal), nei.shape[1], []
        for t in range(steps):
            if t:
                memory1, memory2 = self.fronts(torch.cat((p, v), 1), memory1, memory2)
            code1, code2 = self.out1(memory1[0]), self.out2(memory2[0])
            tau = torch.sigmoid(self.tau(torch.cat((code1, goal_code), 1))) + dt
            force = ((goal - p) / ((steps - t) * dt) - v) / tau
            others = nei[:, t]
            pairs = torch.cat((code2[:, None].expand(-1, others.shape[1], -1), self.enc_nei(others)), -1)
            k = self.k_max * torch.sigmoid(self.k(pairs))[..., 0] * mask
            away = p[:, None] - others[..., :2]
            distance = (away.square().sum(-1) + 1e-8).sqrt()
            force = force + ((k * torch.exp(-distance / self.r_col) / distance)[..., None] * away).sum(1)
            v = v + dt * force
            p = p + dt * v
            path.append(p)
        return torch.stack(path, 1)


def timed(run, repeats):
    """Median seconds of `run`, after one that does not count."""
    run()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def traj_cases(windows, observed, predicted, dt):
    """What is timed of the roll-out, on the default device."""
    net = SocialForce()
    obs, goal = torch.randn(windows, observed, 4), torch.randn(windows, 2) + 100
    nei, mask = torch.randn(windows, predicted, SLOTS, 4) * 10, (torch.rand(windows, SLOTS) < PRESENT).float()
    truth = torch.randn(windows, predicted, 2)

    @torch.no_grad()
    def forward():
        net(obs, goal, nei, mask, dt)

    def train():
        net.zero_grad()
        (net(obs, goal, nei, mask, dt) - truth).square().mean().backward()

    many = []

    # As published: every goal of a window is a window of its own, history included.
    @torch.no_grad()
    def forward_k20():
        if not many:
            many.extend(x.repeat_interleave(GOALS, 0) for x in (obs, goal, nei, mask))
            many[1] = many[1] + torch.randn(windows * GOALS, 2)
        net(*many, dt)

    return {"forward": forward, "train": train, "forward_k20": forward_k20}


def goal_cases(windows, observed, predicted, modes):
    """What is timed of the goal network, on the default device."""
    net = GoalNet(observed, predicted)
    obs, nei = torch.randn(windows, observed, 4), torch.randn(windows, SLOTS, observed, 4)
    mask, centres = (torch.rand(windows, SLOTS) < PRESENT).float(), torch.randn(modes, predicted, 2)
    truth, many, one = torch.randn(windows, predicted, 2), torch.randint(modes, (windows, GOALS)), torch.randint(modes, (windows, 1))

    @torch.no_grad()
    def forward():
        net(obs, nei, mask, centres, many)

    def train():
        net.zero_grad()
        logits, futures = net(obs, nei, mask, centres, one)
        soft = torch.softmax(logits.detach(), -1)
        (F.smooth_l1_loss(futures[:, 0], truth) + F.cross_entropy(logits, soft)).backward()

    return {"forward": forward, "train": train}


def bench(threads, windows, repeats):
    torch.set_num_threads(threads)
    torch.manual_seed(0)
    seconds = {}
    for name, (observed, predicted, modes, dt) in LENGTHS.items():
        for key, run in traj_cases(windows, observed, predicted, dt).items():
            seconds[f"{name}.traj.{key}"] = timed(run, 1 if key == "forward_k20" else repeats)
        # A pass takes milliseconds: more of them, so that their median is steady.
        for key, run in goal_cases(windows, observed, predicted, modes).items():
            seconds[f"{name}.goal.{key}"] = timed(run, 5 * repeats)
    print(json.dumps({key: round(value / windows * 1e3, 4) for key, value in seconds.items()}))


def recorded(run):
    """`run` as a CUDA graph."""
    side = torch.cuda.Stream()
    side.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(side):
        for _ in range(2):
            run()
    torch.cuda.current_stream().wait_stream(side)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        run()
    return graph.replay


def on_gpu(run, record, case_seconds):
    """Milliseconds of `run` with the GPU done, and MiB it held at most; neither when it lacks memory."""

    def once(run):
        start = time.perf_counter()
        run()
        torch.cuda.synchronize()
        return time.perf_counter() - start

    torch.cuda.empty_cache()
    before = torch.cuda.memory_reserved()
    torch.cuda.reset_peak_memory_stats()
    try:
        run = recorded(run) if record else run
        once(run), once(run)
        begun, seconds = time.perf_counter(), []
        while len(seconds) < 3 or time.perf_counter() - begun < case_seconds:
            seconds.append(once(run))
    except RuntimeError as error:
        # While a graph is recorded, lack of memory shows as a failed recording.
        if not record and not isinstance(error, torch.cuda.OutOfMemoryError):
            raise
        return {"ms": None, "mib": None}
    mib = (torch.cuda.max_memory_reserved() - before) / 2**20
    return {"ms": round(statistics.median(seconds) * 1e3, 4), "mib": round(mib, 1)}


def bench_gpu(device, batches, record, case_seconds, seconds):
    """Prints each case as a JSON line when it is measured, the first batches first."""
    torch.set_default_device(device)
    torch.set_float32_matmul_precision("highest")
    torch.backends.cudnn.allow_tf32 = False
    torch.manual_seed(0)
    for name, (observed, predicted, modes, dt) in LENGTHS.items():
        for windows in batches:
            for kind, cases in (("traj", lambda: traj_cases(windows, observed, predicted, dt)), ("goal", lambda: goal_cases(windows, observed, predicted, modes))):
                runs = cases()
                for key in ("train", "forward"):
                    if time.perf_counter() - BEGUN < seconds:
                        cell = on_gpu(runs[key], record, case_seconds)
                        print(json.dumps({f"{name}.{kind}.{key}@{windows}": cell}), flush=True)


def golden(path):
    from safetensors.torch import save_file

    torch.manual_seed(7)
    tensors = {}
    b, observed, predicted, slots, modes, k, dt = 3, 6, 5, 4, 7, 3, 0.1
    obs, nei_observed, centres = torch.randn(b, observed, 4), torch.randn(b, slots, observed, 4), torch.randn(modes, predicted, 2)
    pick = torch.stack([torch.randperm(modes)[:k] for _ in range(b)])
    mask = torch.tensor([[1.0, 1, 0, 1], [1, 0, 0, 0], [1, 1, 1, 1]])
    net = GoalNet(observed, predicted, width=16)
    logits, futures = net(obs, nei_observed, mask, centres, pick)
    (logits.square().sum() + futures.square().sum()).backward()
    for name, weight in net.named_parameters():
        tensors[f"goal.weight.{name}"], tensors[f"goal.grad.{name}"] = weight.detach(), weight.grad
    tensors |= {"goal.obs": obs, "goal.nei": nei_observed, "goal.mask": mask, "goal.modes": centres, "goal.pick": pick}
    tensors |= {"goal.logits": logits.detach(), "goal.traj": futures.detach()}
    force = SocialForce(hidden=12, embedding=8, code=6, encoder=(10, 9), decoder=(11, 10, 9))
    goal, nei = torch.randn(b, 2) * 5 + 10, torch.randn(b, predicted, slots, 4) * 10
    positions = force(obs, goal, nei, mask, dt)
    positions.square().sum().backward()
    for name, weight in force.named_parameters():
        tensors[f"traj.weight.{name}"], tensors[f"traj.grad.{name}"] = weight.detach(), weight.grad
    tensors |= {"traj.obs": obs, "traj.goal": goal, "traj.nei": nei, "traj.mask": mask, "traj.path": positions.detach()}
    notes = {"dt": str(dt), "r_col": "26", "a": "100", "loss": "sum of squares of all outputs"}
    save_file({name: tensor.contiguous().clone() for name, tensor in tensors.items()}, path, notes)
    print(f"{len(tensors)} tensors in {path}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    timing = commands.add_parser("bench")
    timing.add_argument("--threads", type=int, default=2)
    timing.add_argument("--windows", type=int, default=64)
    timing.add_argument("--repeats", type=int, default=7)
    timing.add_argument("--device", default="cpu", help="with cuda: milliseconds per batch and MiB for each of --batches")
    timing.add_argument("--batches", default="64,1024,4096,256", help="windows in a batch, with --device cuda")
    timing.add_argument("--record", action="store_true", help="launch each case as one CUDA graph")
    timing.add_argument("--case-seconds", type=float, default=0.25, help="time for the repeats of a case, with --device cuda")
    timing.add_argument("--seconds", type=float, default=40, help="after which no case begins, with --device cuda")
    commands.add_parser("golden").add_argument("out")
    args = parser.parse_args()
    if args.command == "bench" and args.device != "cpu":
        batches = [int(windows) for windows in args.batches.split(",")]
        bench_gpu(args.device, batches, args.record, args.case_seconds, args.seconds)
    elif args.command == "bench":
        bench(args.threads, args.windows, args.repeats)
    else:
        golden(args.out)


if __name__ == "__main__":
    main()
