"""The seeds of simulated rooms, divided once and for all: what is fitted, what is chosen by, and what is judged by.

No method, threshold or weight may be tuned on TEST: only `benchmarks` and `tests` may name it (a test enforces it).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

TRAIN = range(800_000)
VALIDATION = range(800_000, 900_000)
TEST = range(900_000, 1_000_000)

Split = Literal["train", "validation", "test"]
_RANGES: dict[str, range] = {"train": TRAIN, "validation": VALIDATION, "test": TEST}


def seeds(split: Split, count: int, seed: int = 0) -> list[int]:
    """Return ``count`` different seeds of a split, the same ones for the same ``seed``; more begin with the fewer."""
    among = _RANGES[split]
    if not 0 <= count <= len(among):
        raise ValueError(f"{split} has {len(among)} seeds, not {count}")
    order = np.random.default_rng([seed, 71]).permutation(len(among))[:count]
    return [among[int(place)] for place in order]
