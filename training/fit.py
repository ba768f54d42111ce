"""Training on the CPU, one thread: AdamW, cosine schedule, moving average of the weights, checkpoints."""

from __future__ import annotations

import copy
import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from training.augment import drawn_batch
from training.losses import loss_of
from training.network import RoomNetwork
from training.shards import Examples, read_shards

BATCH = 12
SHARDS_EVERY = 250
"""Steps after which new files of pictures are looked for."""


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


def fit(pictures: Path, out: Path, plan: Plan, start: Path | None = None) -> None:
    """Train and leave ``out`` (a checkpoint with weights and their average) every 500 steps and at the end."""
    torch.set_num_threads(1)
    torch.manual_seed(plan.seed)
    rng = np.random.default_rng([plan.seed, 17])
    network = RoomNetwork().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    if start is not None:
        network.load_state_dict(torch.load(start, weights_only=True)["average"])
    average = copy.deepcopy(network).eval()
    optimiser = torch.optim.AdamW(network.parameters(), lr=plan.rate, weight_decay=plan.decay)
    known: set[str] = set()
    examples = read_shards(pictures, known)
    begun, sums, done = time.monotonic(), dict[str, float](), 0
    network.train()
    step = 0
    while (share := progress(plan, step, time.monotonic() - begun)) < 1:
        if step % SHARDS_EVERY == 0 and step:
            examples = grown(examples, pictures, known)
        rate = scheduled(plan, step, share)
        for group in optimiser.param_groups:
            group["lr"] = rate
        chosen = rng.choice(len(examples), BATCH)
        batch = {
            name: torch.from_numpy(np.ascontiguousarray(a)) for name, a in drawn_batch(rng, examples, chosen).items()
        }
        batch["label"] = batch["label"].long()
        picture = batch["picture"].contiguous(memory_format=torch.channels_last)
        loss, parts = loss_of(network(picture), batch)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(network.parameters(), 2.0)
        optimiser.step()
        follow(average, network, min(plan.average, (step + 1) / (step + 10)))
        for name, value in parts.items():
            sums[name] = sums.get(name, 0.0) + value
        done += 1
        step += 1
        if done == 100:
            shown = " ".join(f"{name} {value / done:.3f}" for name, value in sums.items())
            print(f"{step} {shown} of {len(examples)} at {time.monotonic() - begun:.0f} s", flush=True)  # noqa: T201
            sums, done = {}, 0
        if step % 250 == 0:
            _keep(out, network, average, step)
    _keep(out, network, average, step)


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
