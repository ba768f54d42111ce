"""Training on the CPU, one thread: AdamW, cosine schedule, moving average of the weights, checkpoints."""

from __future__ import annotations

import copy
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from training.augment import Arrays, drawn_batch
from training.network import RoomNetwork, loss_of
from training.shards import Examples, read_shards

BATCH = 12
SHARDS_EVERY = 250
"""Steps after which new files of pictures are looked for."""
KEPT_EVERY, SAID_EVERY = 250, 100


@dataclass(frozen=True)
class Plan:
    """How long and how fast."""

    steps: int
    """At most."""
    minutes: float | None = None
    """The schedule ends after this time, if it has not reached ``steps`` before."""
    rate: float = 2.5e-3
    warm_up: int = 150
    decay: float = 0.02
    average: float = 0.998
    seed: int = 1


@dataclass
class Learner:
    """The network in training, its averaged copy, and what changes it."""

    network: RoomNetwork
    average: RoomNetwork
    optimiser: torch.optim.Optimizer

    def step(self, drawn: Arrays, rate: float, share: float) -> dict[str, float]:
        """Learn from one batch, shapes as `training.shards.Examples`; return the parts of its loss.

        ``share`` is how slowly the average follows.
        """
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        batch = {name: torch.from_numpy(np.ascontiguousarray(values)) for name, values in drawn.items()}
        batch["label"] = batch["label"].long()
        picture = batch["picture"].contiguous(memory_format=torch.channels_last)
        loss, parts = loss_of(self.network(picture), batch)
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self.optimiser.step()
        follow(self.average, self.network, share)
        return parts


def learner(plan: Plan, start: Path | None) -> Learner:
    """Return a network with weights drawn by the plan's seed, or those of a checkpoint's average."""
    torch.set_num_threads(1)
    torch.manual_seed(plan.seed)
    network = RoomNetwork().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    if start is not None:
        network.load_state_dict(torch.load(start, weights_only=True)["average"])
    average = copy.deepcopy(network).eval()
    network.train()
    return Learner(network, average, torch.optim.AdamW(network.parameters(), lr=plan.rate, weight_decay=plan.decay))


def fit(pictures: Path, out: Path, plan: Plan, start: Path | None = None) -> None:
    """Train and leave ``out`` (a checkpoint with weights and their average) every 250 steps and at the end."""
    rng = np.random.default_rng([plan.seed, 17])
    learning = learner(plan, start)
    known: set[str] = set()
    examples = read_shards(pictures, known)
    begun, sums, step = time.monotonic(), dict[str, float](), 0
    while (share := progress(plan, step, time.monotonic() - begun)) < 1:
        if step % SHARDS_EVERY == 0 and step:
            examples = grown(examples, pictures, known)
        drawn = drawn_batch(rng, examples, rng.choice(len(examples), BATCH))
        slow = min(plan.average, (step + 1) / (step + 10))
        for name, value in learning.step(drawn, scheduled(plan, step, share), slow).items():
            sums[name] = sums.get(name, 0.0) + value / SAID_EVERY
        step += 1
        if step % SAID_EVERY == 0:
            shown = " ".join(f"{name} {value:.3f}" for name, value in sums.items())
            print(f"{step} {shown} of {len(examples)} at {time.monotonic() - begun:.0f} s", flush=True)  # noqa: T201
            sums = {}
        if step % KEPT_EVERY == 0:
            _keep(out, learning.network, learning.average, step)
    _keep(out, learning.network, learning.average, step)


def _keep(out: Path, network: RoomNetwork, average: RoomNetwork, step: int) -> None:
    part = out.with_suffix(".part")
    torch.save({"weights": network.state_dict(), "average": average.state_dict(), "step": step}, part)
    part.rename(out)


def grown(examples: Examples, pictures: Path, known: set[str]) -> Examples:
    """Return the examples with those of new files."""
    if all(f.name in known for f in pictures.glob("*.npz")):
        return examples
    more = read_shards(pictures, known)
    names = ("picture", "label", "ceiling_rad", "floor_rad", "corner")
    return Examples(*(np.concatenate([getattr(examples, n), getattr(more, n)]) for n in names))


def progress(plan: Plan, step: int, elapsed_s: float) -> float:
    """Return how much of the schedule is done; 1 ends it."""
    timed = elapsed_s / (60 * plan.minutes) if plan.minutes is not None else 0.0
    return max(step / plan.steps, timed)


def scheduled(plan: Plan, step: int, share: float) -> float:
    """Return the learning rate of a step."""
    if step < plan.warm_up:
        return plan.rate * (step + 1) / plan.warm_up
    return plan.rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share)))


@torch.no_grad()
def follow(average: torch.nn.Module, network: torch.nn.Module, share: float) -> None:
    """Move the averaged weights towards the network's."""
    for kept, new in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if kept.dtype.is_floating_point:
            kept.mul_(share).add_(new, alpha=1 - share)
        else:
            kept.copy_(new)
