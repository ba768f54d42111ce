"""Judge a network's file: on pictures of validation views, on fully lit rooms, on real pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.seeds import Split
from processing.ground.arrays import Floats
from processing.pictures.images import LuminanceImage
from processing.segmentation.embedded import WIDTH_PX, scene_evidence
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from training.labels import SKIRTING, boundary_latitudes
from training.real import SEEN, furniture_masks, zind_layouts
from training.rooms.paints import Tile
from training.rooms.soup import class_picture, small_labels
from training.scores import Tally, floor_iou
from training.shards import read_shard


def columns_of(evidence: SceneEvidence) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return boundaries and sigmas, shape (4, N), radians."""
    edges = evidence.boundary
    if edges is None:
        raise ValueError("no boundary in the evidence")
    return np.stack([edges.ceiling_rad, edges.floor_rad, edges.ceiling_sigma_rad, edges.floor_sigma_rad])


def on_validation(model: Path, folder: Path, tiles: list[Tile], *, quality: str = "standard", every: int = 1) -> Tally:
    """Return the figures of a shipped file on pictures of a folder's views, as `scene_evidence` answers."""
    import torch

    from processing.segmentation import embedded
    from training.augment import lesson
    from training.looks import Bank

    tally, device = Tally(), torch.device("cpu")
    bank, generator = Bank(tiles, device), torch.Generator()
    generator.manual_seed(7)
    network, turns = embedded._network(model), embedded.TURNS_PX[quality]  # noqa: SLF001
    for path in sorted(folder.glob("*.npz")):
        shard = read_shard(path)
        for index in range(0, len(shard["label"]), every):
            one = {name: torch.from_numpy(values[index : index + 1]) for name, values in shard.items()}
            truth = lesson(one, bank, generator, augmented=False)
            shown = truth.picture[0].permute(1, 2, 0).numpy()
            found, columns, _ = embedded._run(network, embedded._turned(shown, turns))  # noqa: SLF001
            edges = embedded._boundary(network, columns, turns)  # noqa: SLF001
            label = truth.label[0, ::2, ::2].numpy()
            tally.add_classes(embedded._mean(found, turns), np.where(label == SKIRTING, SceneClass.WALL, label))  # noqa: SLF001
            stacked = np.stack([edges.ceiling_rad, edges.floor_rad, edges.ceiling_sigma_rad, edges.floor_sigma_rad])
            truths = (one[name][0].numpy().reshape(-1, 2).mean(axis=1) for name in ("ceiling_rad", "floor_rad"))
            tally.add_columns(stacked, *truths)
    return tally


def on_rooms(model: Path, split: Split, count: int, *, quality: str = "standard", empty: bool = False) -> Tally:
    """Return the figures on fully lit simulated rooms (`benchmarks.truth_rooms`), as calibrated pictures."""
    from benchmarks.truth_rooms import kept_list, truth_of

    tally = Tally()
    for seed, use in kept_list(split, count):
        room, pictures = truth_of(seed, use)
        rgb = pictures.empty_rgb if empty else pictures.luminance_rgb
        evidence = scene_evidence(luminance_image(rgb), quality=quality, model=model)
        if not empty:
            tally.add_classes(evidence.probabilities, small_labels(class_picture(pictures)))
        plan = room.plan
        edges = boundary_latitudes(plan.polygon, (0.0, 0.0), plan.camera_height_m, plan.height_m, WIDTH_PX)
        tally.add_columns(columns_of(evidence), *edges)
    return tally


def luminance_image(rgb: Floats) -> LuminanceImage:
    """Return a simulated panorama (H, W, 3), cd/m2, as a calibrated picture."""
    height, width = rgb.shape[:2]
    sure = np.full((height, width), 0.01, np.float32)
    return LuminanceImage(rgb, sure, np.zeros((height, width), np.uint8), Equirectangular(width, height), 0.02)


def on_real(model: Path, shared: Path, *, quality: str = "reference", scored_half: bool = False) -> dict[str, Any]:
    """Return floor IoU and boundary errors on ZInD rooms, furniture IoU on hand-drawn masks."""
    rooms = {}
    for number, layout in enumerate(zind_layouts(shared / "panoramas" / "zind")):
        if (number < SEEN) == scored_half:
            continue
        found = columns_of(scene_evidence(layout.image, quality=quality, model=model))
        away = np.degrees(np.abs(found[:2] - np.stack([layout.ceiling_rad, layout.floor_rad]))).mean(axis=1)
        rooms[layout.name] = {
            "floor_iou": round(floor_iou(found[1], layout.floor_rad), 3),
            "ceiling_deg": round(float(away[0]), 2),
            "floor_deg": round(float(away[1]), 2),
        }
    masks = {}
    for name, image, mask in [] if scored_half else furniture_masks(shared / "panoramas" / "furnished"):
        share = scene_evidence(image, quality=quality, model=model)
        masks[name] = furniture_iou(share, mask)
    return {"rooms": rooms, "masks": masks}


def furniture_iou(evidence: SceneEvidence, mask: np.ndarray[Any, np.dtype[np.uint8]]) -> dict[str, float]:
    """Return IoU, precision and recall by solid angle of the likeliest class, where the mask (H, W) judges."""
    import cv2

    rows, columns = mask.shape
    tall = [cv2.resize(p, (columns, rows), interpolation=cv2.INTER_LINEAR) for p in evidence.probabilities]
    found = np.argmax(tall, axis=0) == SceneClass.FURNITURE
    weight = np.cos((0.5 - (np.arange(rows) + 0.5) / rows) * np.pi)[:, None] * (mask != 128)
    true = mask == 255
    hit, taken, there = ((one * weight).sum() for one in (found & true, found, true))
    return {
        "iou": round(float(hit / (taken + there - hit)), 3),
        "precision": round(float(hit / max(taken, 1e-9)), 3),
        "recall": round(float(hit / there), 3),
    }
