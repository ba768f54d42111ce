"""What the network is asked for."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

CLASS_WEIGHTS = (1.0, 1.0, 1.0, 2.0, 2.0, 2.2, 1.8, 1.5)
"""Of `SceneClass`: those that are rare and matter count more."""
CORNER_WEIGHT = 6.0


def loss_of(outputs: tuple[Tensor, Tensor, Tensor], truth: dict[str, Tensor]) -> tuple[Tensor, dict[str, float]]:
    """Return the loss and its parts."""
    logits, structure, columns = outputs
    weights = torch.tensor(CLASS_WEIGHTS)
    # One of the four pixels under each of the output's, in turn: cheaper than all, and centred on the mean.
    down, right = divmod(int(torch.randint(4, ())), 2)
    label = truth["label"][:, down::2, right::2]
    classes = functional.cross_entropy(logits, label, weight=weights, label_smoothing=0.02)
    ceiling, floor = (_halved(truth[key]) for key in ("ceiling_rad", "floor_rad"))
    dense = functional.binary_cross_entropy_with_logits(structure, _structure(ceiling, floor, structure.shape[2]))
    target = torch.stack([ceiling, floor], dim=1)
    away = (columns[:, :2] - target).abs()
    log_sigma = columns[:, 2:4].clamp(-6.0, 1.0)
    # A Laplace distribution of that standard deviation, and a plain distance that does not depend on it.
    edges = (math.sqrt(2) * away * torch.exp(-log_sigma) + log_sigma).mean() + 6 * away.mean()
    corner = functional.binary_cross_entropy_with_logits(
        columns[:, 4], _halved(truth["corner"]), pos_weight=torch.tensor(CORNER_WEIGHT)
    )
    total = classes + 0.7 * dense + 0.15 * edges + 0.3 * corner
    parts = {"classes": classes, "dense": dense, "degrees": away.mean() * (180 / math.pi), "corner": corner}
    return total, {name: float(part.detach()) for name, part in parts.items()}


def _halved(columns: Tensor) -> Tensor:
    """Return means of neighbouring columns."""
    return (columns[..., 0::2] + columns[..., 1::2]) / 2


def _structure(ceiling: Tensor, floor: Tensor, rows: int) -> Tensor:
    """Return how much of each pixel lies above the ceiling's edge and below the floor's, (B, 2, rows, n)."""
    top = (0.5 - torch.arange(rows) / rows) * math.pi
    step = math.pi / rows
    above = ((top.view(1, rows, 1) - ceiling[:, None]) / step).clamp(0, 1)
    below = ((floor[:, None] - (top - step).view(1, rows, 1)) / step).clamp(0, 1)
    return torch.stack([above, below], dim=1)
