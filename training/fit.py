"""Training: views on the device, new pictures of them at every step, AdamW, cosine schedule, averaged weights."""

from __future__ import annotations

import copy
import math
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import torch

from training.augment import lesson
from training.looks import Bank, Batch
from training.network import RoomNetwork, loss_of
from training.rooms.paints import Tile
from training.shards import Views, read_shard

SAID_EVERY, KEPT_EVERY, LOOKED_EVERY = 100, 500, 25
"""Steps after which figures are printed, a checkpoint is left, new files of views are looked for."""

FIRST_VIEWS_S = 600.0
"""Chosen: a worker's first batch takes a minute, with the textures made first two."""


@dataclass(frozen=True)
class Plan:
    """How long and how fast."""

    steps: int = 100_000
    """At most."""
    minutes: float | None = None
    """The schedule ends after this time, if it has not reached ``steps`` before."""
    batch: int = 112
    rate: float = 1.6e-3
    warm_up: int = 300
    decay: float = 0.03
    average: float = 0.999
    most: int = 30_000
    """Views that are held; later ones take the places of the first."""
    seed: int = 1


class Held:
    """Views on a device: files of a folder are taken in as they come, and may be deleted then."""

    def __init__(self, folder: Path, device: torch.device, most: int, *, delete: bool) -> None:
        self.folder, self.device, self.most, self.delete = folder, device, most, delete
        self.arrays: Batch = {}
        self.count = self.taken = 0
        self.known: set[str] = set()
        self.reader, self.reading = ThreadPoolExecutor(1), list[Future[Views]]()

    def _read(self, path: Path) -> Views:
        views = read_shard(path)
        if self.delete:
            path.unlink()
        return views

    def look(self, files: int = 4) -> None:
        """Take in what was read of new files, and have others read beside the training, ``files`` at a time."""
        new = [f for f in sorted(self.folder.glob("*.npz")) if f.name not in self.known]
        for path in new[: files - len(self.reading)]:
            self.known.add(path.name)
            self.reading.append(self.reader.submit(self._read, path))
        ready = [one for one in self.reading if one.done()]
        self.reading = [one for one in self.reading if one not in ready]
        for one in ready:
            views = {name: torch.from_numpy(values) for name, values in one.result().items()}
            if not self.arrays:
                for name, values in views.items():
                    shape = (self.most, *values.shape[1:])
                    self.arrays[name] = torch.empty(shape, dtype=values.dtype, device=self.device)
            length = len(views["label"])
            at = (torch.arange(length) + self.taken) % self.most
            for name, values in views.items():
                self.arrays[name][at.to(self.device)] = values.to(self.device)
            self.taken += length
            self.count = min(self.taken, self.most)

    def wait(self) -> None:
        """Return when the first views are there; raises FileNotFoundError after `FIRST_VIEWS_S`."""
        end_s = time.monotonic() + FIRST_VIEWS_S
        while not self.count:
            if time.monotonic() > end_s:
                raise FileNotFoundError(f"no views came to {self.folder} in {FIRST_VIEWS_S:.0f} s: generate some")
            self.look()
            time.sleep(0.2)

    def some(self, chosen: torch.Tensor) -> Batch:
        """Return the views of some numbers."""
        return {name: values[chosen] for name, values in self.arrays.items()}


def fit(folder: Path, out: Path, tiles: list[Tile], plan: Plan, start: Path | None = None, *, delete: bool) -> None:
    """Train and leave ``out`` (weights, their average, the optimiser's state) every so often and at the end.

    ``start``: a checkpoint to go on from, with the schedule and the optimiser as they were left there.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    torch.manual_seed(plan.seed)
    torch.backends.cudnn.benchmark = True
    network = RoomNetwork().to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    average = copy.deepcopy(network).eval()
    optimiser = torch.optim.AdamW(network.parameters(), lr=plan.rate, weight_decay=plan.decay)
    step, spent_s = 0, 0.0
    if start is not None:
        kept = torch.load(start, weights_only=True, map_location=device)
        network.load_state_dict(kept["weights"])
        average.load_state_dict(kept["average"])
        optimiser.load_state_dict(kept["optimiser"])
        step, spent_s = int(kept["step"]), float(kept["spent_s"])
    generator = torch.Generator(device=device)
    generator.manual_seed(plan.seed + step)
    held, bank = Held(folder, device, plan.most, delete=delete), Bank(tiles, device)
    held.wait()
    begun = time.monotonic()

    def keep() -> None:
        state = {"weights": network.state_dict(), "average": average.state_dict(), "step": step}
        state |= {"optimiser": optimiser.state_dict(), "spent_s": spent_s + time.monotonic() - begun}
        torch.save(state, out.with_suffix(".part"))
        out.with_suffix(".part").rename(out)

    while (share := progress(plan, step, spent_s + time.monotonic() - begun)) < 1:
        if step % LOOKED_EVERY == 0:
            held.look()
        chosen = torch.randint(held.count, (plan.batch,), generator=generator, device=device)
        truth = lesson(held.some(chosen), bank, generator)
        for group in optimiser.param_groups:
            group["lr"] = scheduled(plan, step, share)
        with torch.autocast(device.type, dtype=torch.bfloat16, enabled=device.type == "cuda"):
            outputs = network(truth.picture.contiguous(memory_format=torch.channels_last))
        loss, parts = loss_of(outputs, truth)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        size = torch.nn.utils.clip_grad_norm_(network.parameters(), 2.0)
        if torch.isfinite(size):
            optimiser.step()
            follow(average, network, min(plan.average, (step + 1) / (step + 10)))
        step += 1
        if step % SAID_EVERY == 0:
            shown = " ".join(f"{name} {float(value):.3f}" for name, value in parts.items())
            at_s = spent_s + time.monotonic() - begun
            print(f"{step} {shown} of {held.taken} at {at_s:.0f} s", flush=True)  # noqa: T201
        if step % KEPT_EVERY == 0:
            keep()
    keep()


def progress(plan: Plan, step: int, elapsed_s: float) -> float:
    """Return how much of the schedule is done; 1 ends it."""
    timed = elapsed_s / (60 * plan.minutes) if plan.minutes is not None else 0.0
    return max(step / plan.steps, timed)


def scheduled(plan: Plan, step: int, share: float) -> float:
    """Return the learning rate of a step."""
    if step < plan.warm_up:
        return plan.rate * (step + 1) / plan.warm_up
    return plan.rate * (0.005 + 0.995 * 0.5 * (1 + math.cos(math.pi * share)))


@torch.no_grad()
def follow(average: torch.nn.Module, network: torch.nn.Module, share: float) -> None:
    """Move the averaged weights towards the network's."""
    for kept, new in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if kept.dtype.is_floating_point:
            kept.mul_(share).add_(new, alpha=1 - share)
        else:
            kept.copy_(new)
