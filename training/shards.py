"""Training pictures on disk: one uncompressed file a batch, named by its first seed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from processing.ground.arrays import Bytes, Floats
from training.recipe import Example


@dataclass(frozen=True)
class Examples:
    """Many examples: arrays with the example first, see `training.recipe.Example`."""

    picture: Bytes
    label: Bytes
    ceiling_rad: Floats
    floor_rad: Floats
    corner: Floats

    def __len__(self) -> int:
        return len(self.picture)


def write_shard(folder: Path, first_seed: int, examples: Iterable[Example]) -> int:
    """Write one batch, whole or not at all; return how many pictures it has."""
    found = list(examples)
    arrays = {f.name: np.stack([getattr(e, f.name) for e in found]) for f in fields(Example)}
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / f"{first_seed:06d}.part"
    with part.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
    part.rename(folder / f"{first_seed:06d}.npz")
    return len(found)


def read_shards(folder: Path, known: set[str] | None = None) -> Examples:
    """Return all examples of a folder, or those of files not yet in ``known``, which is added to."""
    known = set() if known is None else known
    files = [f for f in sorted(folder.glob("*.npz")) if f.name not in known]
    known.update(f.name for f in files)
    loaded = [np.load(f) for f in files]
    return Examples(*(np.concatenate([one[f.name] for one in loaded]) for f in fields(Examples)))
