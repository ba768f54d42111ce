"""The room network and its losses: classes of pixels, and per column both boundaries, their uncertainty and corners.

Plain 3 x 3 convolutions that go round the seam; an encoder to 1/16, a decoder to 1/2. Boundaries come from a dense
picture of what would be ceiling, wall and floor if the room were empty, summed over each column, and a correction by
one-dimensional convolutions along the columns.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

CLASSES = 8
HEIGHT, WIDTH = 128, 256
FIRST, SECOND, THIRD, DEEP, COLUMN = 16, 40, 80, 160, 96


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


class Columns(nn.Module):
    """From the decoder's features (B, 16, 64, 128) and the deepest ones to 6 values a column (B, 6, 128)."""

    def __init__(self) -> None:
        super().__init__()
        self.fold = nn.Sequential(
            nn.Conv2d(FIRST, 32, (4, 1), (4, 1)), nn.ReLU(),
            nn.Conv2d(32, 64, (4, 1), (4, 1)), nn.ReLU(),
            nn.Conv2d(64, COLUMN, (4, 1)),
        )  # fmt: skip
        self.deep = nn.Conv2d(DEEP, COLUMN, (HEIGHT // 16, 1))
        self.edges = nn.Conv1d(2, COLUMN, 1)
        self.rings = nn.Sequential(*(Ring(COLUMN, d) for d in (1, 2, 4, 8, 16, 4, 1)))
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
    """Input (B, 3, 128, 256) of 0..1; see ``forward``."""

    latitude: Tensor
    weights: Tensor

    def __init__(self) -> None:
        super().__init__()
        latitude = (0.5 - (torch.arange(HEIGHT) + 0.5) / HEIGHT) * math.pi
        self.register_buffer("latitude", (latitude / (math.pi / 2)).view(1, 1, HEIGHT, 1), persistent=False)
        self.first = Around(4, FIRST, 2)
        self.down2, self.second = Around(FIRST, SECOND, 2), Block(SECOND)
        self.down3, self.third = Around(SECOND, THIRD, 2), Block(THIRD)
        self.down4, self.deep = Around(THIRD, DEEP, 2), nn.Sequential(Block(DEEP), Around(DEEP, DEEP))
        self.narrow3, self.up3 = nn.Conv2d(DEEP, THIRD, 1), Around(THIRD, THIRD)
        self.narrow2, self.up2 = nn.Conv2d(THIRD, SECOND, 1), Around(SECOND, SECOND)
        self.narrow1, self.up1 = nn.Conv2d(SECOND, FIRST, 1), Around(FIRST, FIRST)
        self.classes = nn.Conv2d(FIRST, CLASSES, 1)
        self.structure = nn.Conv2d(FIRST, 2, 1)
        self.columns = Columns()

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return class logits (B, 8, 64, 128), structure logits (B, 2, 64, 128) and columns (B, 5, 128).

        Structure: above the ceiling's edge, below the floor's edge. Columns: ceiling and floor latitude (rad), their
        log sigmas, the corner's logit.
        """
        batch = picture.shape[0]
        x = torch.cat([picture - 0.5, self.latitude.expand(batch, 1, HEIGHT, WIDTH)], dim=1)
        one = self.first(x)
        two = self.second(self.down2(one))
        three = self.third(self.down3(two))
        deep = self.deep(self.down4(three))
        fine = self.up3(_twice(self.narrow3(deep)) + three)
        fine = self.up2(_twice(self.narrow2(fine)) + two)
        fine = self.up1(_twice(self.narrow1(fine)) + one)
        structure = self.structure(fine)
        share = torch.sigmoid(structure).mean(dim=2) * math.pi
        edges = torch.stack([math.pi / 2 - share[:, 0], share[:, 1] - math.pi / 2], dim=1)
        found = self.columns(fine, deep, edges)
        latitudes = edges + 0.2 * found[:, :2]
        return self.classes(fine), structure, torch.cat([latitudes, found[:, 2:5]], dim=1)


def _twice(x: Tensor) -> Tensor:
    """Return features at double size by repetition: the convolution that follows smooths them."""
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


class Shipped(nn.Module):
    """What is exported: probabilities (B, 8, 128, 256), columns (B, 5, 256) with sigmas in radians and corners 0..1."""

    def __init__(self, network: RoomNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor]:
        """Return probabilities and columns."""
        logits, _, columns = self.network(picture)
        tall = functional.interpolate(logits, size=(HEIGHT, WIDTH // 2), mode="bilinear", align_corners=False)
        flat = around(tall.reshape(tall.shape[0], CLASSES * HEIGHT, WIDTH // 2), WIDTH)
        probabilities = torch.softmax(flat.reshape(-1, CLASSES, HEIGHT, WIDTH), dim=1)
        wide = around(columns, WIDTH)
        sigma = torch.exp(torch.clamp(wide[:, 2:4], -7.0, 1.0))
        return probabilities, torch.cat([wide[:, :2], sigma, torch.sigmoid(wide[:, 4:5])], dim=1)


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
