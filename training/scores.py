"""Figures of a network on pictures with truth: IoU of classes, boundary errors, floor IoU, calibration of sigma."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from shapely.geometry import Polygon

from processing.ground.arrays import Bytes, Doubles, Reals
from processing.segmentation.evidence import SceneClass
from training.labels import column_longitudes

COUNT = len(SceneClass)


@dataclass
class Tally:
    """Sums over pictures; angles in degrees."""

    confusion: Doubles = field(default_factory=lambda: np.zeros((COUNT, COUNT)))
    ceiling_deg: list[Reals] = field(default_factory=list)
    floor_deg: list[Reals] = field(default_factory=list)
    ceiling_sigmas: list[Reals] = field(default_factory=list)
    floor_sigmas: list[Reals] = field(default_factory=list)
    floor_iou: list[float] = field(default_factory=list)

    def add_classes(self, probabilities: Reals, label: Bytes) -> None:
        """Count pixels (8, H, W) against (H, W), by solid angle."""
        rows = label.shape[0]
        weight = np.cos((0.5 - (np.arange(rows) + 0.5) / rows) * np.pi)[:, None] * np.ones(label.shape)
        found = probabilities.argmax(axis=0)
        cell = label.astype(np.int64) * COUNT + found
        self.confusion += np.bincount(cell.ravel(), weight.ravel(), COUNT**2).reshape(COUNT, COUNT)

    def add_columns(self, found: Reals, ceiling_rad: Reals, floor_rad: Reals) -> None:
        """Compare columns, shape (5, N), with the truth (N,), radians."""
        up, down = np.degrees(found[0] - ceiling_rad), np.degrees(found[1] - floor_rad)
        self.ceiling_deg.append(up)
        self.floor_deg.append(down)
        self.ceiling_sigmas.append(np.degrees(found[2]))
        self.floor_sigmas.append(np.degrees(found[3]))
        self.floor_iou.append(floor_iou(found[1], floor_rad))

    def iou(self) -> dict[str, float]:
        """Return the IoU of each class that occurs."""
        hit = np.diag(self.confusion)
        union = self.confusion.sum(axis=0) + self.confusion.sum(axis=1) - hit
        return {c.name.lower(): float(hit[c] / union[c]) for c in SceneClass if self.confusion[c].sum() > 0}

    def summary(self) -> dict[str, float]:
        """Return all figures."""
        up, down = (np.abs(np.concatenate(v)) for v in (self.ceiling_deg, self.floor_deg))
        s_up, s_down = np.concatenate(self.ceiling_sigmas), np.concatenate(self.floor_sigmas)
        judged = self.confusion.sum()
        return {
            **self.iou(),
            **({"accuracy": float(np.diag(self.confusion).sum() / judged)} if judged else {}),
            "ceiling_deg_mean": float(up.mean()),
            "ceiling_deg_median": float(np.median(up)),
            "floor_deg_mean": float(down.mean()),
            "floor_deg_median": float(np.median(down)),
            "floor_iou_mean": float(np.mean(self.floor_iou)),
            "floor_iou_median": float(np.median(self.floor_iou)),
            "ceiling_within_1_sigma": float((up < s_up).mean()),
            "ceiling_within_2_sigma": float((up < 2 * s_up).mean()),
            "floor_within_1_sigma": float((down < s_down).mean()),
            "floor_within_2_sigma": float((down < 2 * s_down).mean()),
        }

    def rounded(self) -> dict[str, float]:
        """Return all figures, to three places."""
        return {name: round(value, 3) for name, value in self.summary().items()}

    def scales(self) -> tuple[float, float]:
        """Return factors by which sigmas (ceiling, floor) have to be multiplied so that 68 % of errors lie within."""
        pairs = ((self.ceiling_deg, self.ceiling_sigmas), (self.floor_deg, self.floor_sigmas))
        a, b = (np.quantile(np.abs(np.concatenate(e)) / np.concatenate(s), 0.683) for e, s in pairs)
        return float(a), float(b)

    def reliability(self, groups: int = 8) -> list[tuple[float, float]]:
        """Return (mean sigma, root mean square error less the worst 2 %) of both edges, in groups of rising sigma."""
        error = np.abs(np.concatenate([*self.ceiling_deg, *self.floor_deg]))
        sigma = np.concatenate([*self.ceiling_sigmas, *self.floor_sigmas])
        order = np.argsort(sigma)
        out = []
        for part in np.array_split(order, groups):
            kept = np.sort(error[part])[: max(1, int(0.98 * len(part)))]
            out.append((float(sigma[part].mean()), float(np.sqrt((kept**2).mean()))))
        return out


def floor_iou(found_rad: Reals, truth_rad: Reals) -> float:
    """Return the IoU of the floors that two boundaries (N,), radians, enclose."""
    longitude = column_longitudes(len(found_rad))
    rings = []
    for latitude in (found_rad, truth_rad):
        reach = 1 / np.tan(np.clip(-np.asarray(latitude, np.float64), 0.02, 1.55))
        rings.append(Polygon(np.stack([reach * np.sin(longitude), reach * np.cos(longitude)], axis=1)).buffer(0))
    union = rings[0].union(rings[1]).area
    return float(rings[0].intersection(rings[1]).area / union) if union else 0.0
