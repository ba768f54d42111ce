"""Training views on disk: one uncompressed file a batch, named by its first seed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from training.rooms.render import View

Views = dict[str, np.ndarray[Any, np.dtype[Any]]]
"""Arrays of many views by the names of `View`, the view first."""


def write_shard(folder: Path, first_seed: int, views: Iterable[View]) -> int:
    """Write one batch, whole or not at all; return how many views it has."""
    found = list(views)
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / f"{first_seed:06d}.part"
    with part.open("wb") as file:
        np.savez(
            file, allow_pickle=False, **{name: np.stack([getattr(v, name) for v in found]) for name in View._fields}
        )
    part.rename(folder / f"{first_seed:06d}.npz")
    return len(found)


def read_shard(path: Path) -> Views:
    """Return the views of one file."""
    with np.load(path) as file:
        return {name: file[name] for name in View._fields}
