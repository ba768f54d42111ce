"""The room network and its losses: classes of pixels, distances, and per column both boundaries and corners.

Residual convolutions that go round the seam; an encoder to 1/16, where all of the panorama attends to all of it, and a
decoder to 1/2. Boundaries come from a dense picture of what would be ceiling, wall and floor if the room were empty,
summed over each column, and a correction by one-dimensional convolutions along the columns.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from training.augment import Lesson
from training.labels import SKIRTING

CLASSES = SKIRTING + 1
"""What is shipped has one class less: skirting is wall there, and a picture of its own."""
HEIGHT, WIDTH = 256, 512
FIRST, SECOND, THIRD, DEEP, COLUMN = 32, 64, 128, 256, 128
HEADS, ATTENTIONS = 8, 3
DETAILS = 2
"""Skirting's probability, and the log of the distance in camera heights."""


class Around(nn.Module):
    """A convolution that wraps in longitude and repeats the rows at the poles, with normalisation and ReLU."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3, stride, padding=(1, 0), bias=False)
        self.norm = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """Return the features."""
        x = torch.cat([x[..., -1:], x, x[..., :1]], dim=-1)
        found: Tensor = self.norm(self.conv(x))
        return functional.relu(found, inplace=True)


class Block(nn.Module):
    """Two convolutions beside a shortcut."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first, self.second = Around(width, width), Around(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """Return the features."""
        return torch.add(x, self.second(self.first(x)))


class Ring(nn.Module):
    """A dilated convolution along the columns, round the seam, beside a shortcut."""

    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.conv = nn.Conv1d(width, width, 3, dilation=dilation, bias=False)
        self.norm = nn.BatchNorm1d(width)
        self.dilation = dilation

    def forward(self, x: Tensor) -> Tensor:
        """Return the features."""
        d = self.dilation
        around = torch.cat([x[..., -d:], x, x[..., :d]], dim=-1)
        return x + functional.relu(self.norm(self.conv(around)))


class Attention(nn.Module):
    """All of the deepest features attend to all of them: what is one room is seen from all of it."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.before, self.after = nn.LayerNorm(width), nn.LayerNorm(width)
        self.ask, self.give = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.mix = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))

    def forward(self, x: Tensor) -> Tensor:
        """Return the features (B, N, width)."""
        batch, count, width = x.shape
        parts = self.ask(self.before(x)).reshape(batch, count, 3, HEADS, width // HEADS).permute(2, 0, 3, 1, 4)
        weights = torch.softmax(parts[0] @ parts[1].transpose(-1, -2) / math.sqrt(width // HEADS), dim=-1)
        x = x + self.give((weights @ parts[2]).transpose(1, 2).reshape(batch, count, width))
        mixed: Tensor = self.mix(self.after(x))
        return x + mixed


class Columns(nn.Module):
    """From the decoder's features (B, FIRST, 128, 256) and the deepest ones to 6 values a column (B, 6, 256)."""

    def __init__(self) -> None:
        super().__init__()
        self.fold = nn.Sequential(
            nn.Conv2d(FIRST, 48, (4, 1), (4, 1)),
            nn.ReLU(),
            nn.Conv2d(48, 80, (4, 1), (4, 1)),
            nn.ReLU(),
            nn.Conv2d(80, COLUMN, (HEIGHT // 32, 1)),
        )
        self.deep = nn.Conv2d(DEEP, COLUMN, (HEIGHT // 16, 1))
        self.edges = nn.Conv1d(2, COLUMN, 1)
        self.rings = nn.Sequential(*(Ring(COLUMN, d) for d in (1, 2, 4, 8, 16, 32, 8, 2, 1)))
        self.out = nn.Conv1d(COLUMN, 6, 1)

    def forward(self, fine: Tensor, deep: Tensor, edges: Tensor) -> Tensor:
        """Return corrections of both latitudes, both log sigmas, the corner's logit, and a spare."""
        wide = around(self.deep(deep)[:, :, 0], WIDTH // 2)
        x = functional.relu(self.fold(fine)[:, :, 0] + wide + self.edges(edges))
        found: Tensor = self.out(self.rings(x))
        return found


def around(x: Tensor, width: int) -> Tensor:
    """Return columns (B, C, n) interpolated to ``width``, round the seam, middles of columns to middles."""
    n = x.shape[-1]
    scale = width // n
    padded = torch.cat([x[..., -1:], x, x[..., :1]], dim=-1)
    grown = functional.interpolate(padded, scale_factor=float(scale), mode="linear", align_corners=False)
    return grown[..., scale : scale + width]


class RoomNetwork(nn.Module):
    """Input (B, 3, 256, 512) of 0..1; see ``forward``."""

    latitude: Tensor

    def __init__(self) -> None:
        super().__init__()
        latitude = (0.5 - (torch.arange(HEIGHT) + 0.5) / HEIGHT) * math.pi
        self.register_buffer("latitude", (latitude / (math.pi / 2)).view(1, 1, HEIGHT, 1), persistent=False)
        self.first = nn.Sequential(Around(4, FIRST, 2), Around(FIRST, FIRST))
        self.down2, self.second = Around(FIRST, SECOND, 2), Block(SECOND)
        self.down3, self.third = Around(SECOND, THIRD, 2), nn.Sequential(Block(THIRD), Block(THIRD))
        self.down4, self.deep = Around(THIRD, DEEP, 2), nn.Sequential(Block(DEEP), Block(DEEP), Block(DEEP))
        self.place = nn.Parameter(0.02 * torch.randn(1, HEIGHT // 16, 1, DEEP))
        self.attentions = nn.Sequential(*(Attention(DEEP) for _ in range(ATTENTIONS)))
        self.narrow3, self.up3 = nn.Conv2d(DEEP, THIRD, 1), nn.Sequential(Around(THIRD, THIRD), Block(THIRD))
        self.narrow2, self.up2 = nn.Conv2d(THIRD, SECOND, 1), nn.Sequential(Around(SECOND, SECOND), Block(SECOND))
        self.narrow1, self.up1 = nn.Conv2d(SECOND, FIRST, 1), nn.Sequential(Around(FIRST, FIRST), Block(FIRST))
        self.classes = nn.Conv2d(FIRST, CLASSES + 1, 1)
        self.structure = nn.Conv2d(FIRST, 2, 1)
        self.columns = Columns()

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return class logits (B, 9, 128, 256), log distances (B, 128, 256), structure logits and columns.

        Structure (B, 2, 128, 256): above the ceiling's edge, below the floor's edge. Columns (B, 5, 256): ceiling and
        floor latitude (rad), their log sigmas, the corner's logit.
        """
        batch = picture.shape[0]
        x = torch.cat([picture - 0.5, self.latitude.expand(batch, 1, HEIGHT, WIDTH).to(picture.dtype)], dim=1)
        one = self.first(x)
        two = self.second(self.down2(one))
        three = self.third(self.down3(two))
        deep = self.deep(self.down4(three))
        tokens = (deep.permute(0, 2, 3, 1) + self.place).reshape(batch, -1, DEEP)
        deep = self.attentions(tokens).reshape(batch, HEIGHT // 16, WIDTH // 16, DEEP).permute(0, 3, 1, 2)
        fine = self.up3(_twice(self.narrow3(deep)) + three)
        fine = self.up2(_twice(self.narrow2(fine)) + two)
        fine = self.up1(_twice(self.narrow1(fine)) + one)
        found = self.classes(fine)
        structure = self.structure(fine)
        share = torch.sigmoid(structure.float()).mean(dim=2) * math.pi
        edges = torch.stack([math.pi / 2 - share[:, 0], share[:, 1] - math.pi / 2], dim=1)
        changes = self.columns(fine, deep, edges).float()
        latitudes = edges + 0.2 * changes[:, :2]
        return found[:, :CLASSES], found[:, CLASSES], structure, torch.cat([latitudes, changes[:, 2:5]], dim=1)


def _twice(x: Tensor) -> Tensor:
    """Return features at double size by repetition: the convolution that follows smooths them."""
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


class Shipped(nn.Module):
    """What is exported: probabilities (B, 8, 128, 256), columns (B, 5, 256) with sigmas in radians, corners 0..1.

    And details (B, 2, 128, 256): skirting's probability, log of the distance in camera heights.
    """

    def __init__(self, network: RoomNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return probabilities, columns and details."""
        logits, reach, _, columns = self.network(picture)
        shares = torch.softmax(logits, dim=1)
        skirting = shares[:, SKIRTING:]
        wall = shares[:, 1:2] + skirting
        probabilities = torch.cat([shares[:, :1], wall, shares[:, 2:SKIRTING]], dim=1)
        sigma = torch.exp(torch.clamp(columns[:, 2:4], -7.0, 1.0))
        columns = torch.cat([columns[:, :2], sigma, torch.sigmoid(columns[:, 4:5])], dim=1)
        return probabilities, columns, torch.cat([skirting, reach[:, None]], dim=1)


CLASS_WEIGHTS = (1.0, 1.0, 1.0, 2.0, 2.0, 2.2, 1.8, 1.5, 1.5)
"""Of `SceneClass`, and skirting: those that are rare and matter count more."""
CORNER_WEIGHT = 6.0


def loss_of(outputs: tuple[Tensor, Tensor, Tensor, Tensor], truth: Lesson) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the loss and its parts."""
    logits, distance, structure, columns = outputs
    weights = torch.tensor(CLASS_WEIGHTS, device=logits.device)
    # One of the four pixels under each of the output's, in turn: cheaper than all, and centred on the mean.
    down, right = divmod(int(torch.randint(4, ())), 2)
    label, reach = truth.label[:, down::2, right::2], truth.reach[:, down::2, right::2]
    # Pixels near the poles are many and small: they count by half at least.
    rows = (0.5 - (torch.arange(label.shape[1], device=logits.device) + 0.5) / label.shape[1]) * math.pi
    share = 0.5 + 0.5 * torch.cos(rows)[None, :, None]
    each = functional.cross_entropy(logits.float(), label, weight=weights, label_smoothing=0.02, reduction="none")
    classes = (each * share).mean() / share.mean()
    known = torch.isfinite(reach)
    away = torch.where(known, (distance.float() - torch.nan_to_num(reach)).abs(), 0.0)
    depth = (away * (1 + 2 * (label == 5))).sum() / known.sum().clamp(min=1)
    ceiling, floor = _halved(truth.ceiling_rad), _halved(truth.floor_rad)
    wanted = _structure(ceiling, floor, structure.shape[2])
    dense = functional.binary_cross_entropy_with_logits(structure.float(), wanted)
    apart = (columns[:, :2] - torch.stack([ceiling, floor], dim=1)).abs()
    log_sigma = columns[:, 2:4].clamp(-6.0, 1.0)
    # A Laplace distribution of that standard deviation, and a plain distance that does not depend on it.
    edges = (math.sqrt(2) * apart * torch.exp(-log_sigma) + log_sigma).mean() + 6 * apart.mean()
    corner = functional.binary_cross_entropy_with_logits(
        columns[:, 4], _halved(truth.corner), pos_weight=torch.tensor(CORNER_WEIGHT, device=logits.device)
    )
    total = classes + 0.7 * dense + 0.15 * edges + 0.3 * corner + 0.4 * depth
    degrees = apart.mean() * (180 / math.pi)
    parts = {"classes": classes, "dense": dense, "degrees": degrees, "corner": corner, "depth": depth}
    return total, {name: part.detach() for name, part in parts.items()}


def _halved(columns: Tensor) -> Tensor:
    """Return means of neighbouring columns."""
    return (columns[..., 0::2] + columns[..., 1::2]) / 2


def _structure(ceiling: Tensor, floor: Tensor, rows: int) -> Tensor:
    """Return how much of each pixel lies above the ceiling's edge and below the floor's, (B, 2, rows, n)."""
    top = (0.5 - torch.arange(rows, device=ceiling.device) / rows) * math.pi
    step = math.pi / rows
    above = ((top.view(1, rows, 1) - ceiling[:, None]) / step).clamp(0, 1)
    below = ((floor[:, None] - (top - step).view(1, rows, 1)) / step).clamp(0, 1)
    return torch.stack([above, below], dim=1)
