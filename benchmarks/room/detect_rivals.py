"""Other ways to a furniture mask, on the same pictures: a published network, colours alone, our network unjoined."""

from __future__ import annotations

import json
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.room.detect_truth import DATA
from processing.errors import SegmenterError
from processing.ground.arrays import Flags
from processing.ground.room_model import RoomModel
from processing.ground.seam import resized
from processing.pictures.images import RelativeImage
from processing.pictures.preview import preview_rgb8
from processing.removal.tripod import strangeness
from processing.segmentation.around import ViewPlan, segment_around
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.segmentation.segmenters import Segmenter, open_segmenter
from processing.sphere import Equirectangular
from processing.surfaces.maps import CEILING, surface_maps

VOC_CONTRACT = {
    "name": "DeepLab v3, MobileNet v2, Pascal VOC",
    "input": "MobilenetV2/MobilenetV2/input",
    "layout": "NHWC",
    "input_type": "uint8",
    "input_range": 255,
    "size_px": 513,
    "classes": "voc",
    "output": "argmax",
    "outputs": ["ArgMax"],
}
ROWS = 512


@lru_cache(maxsize=1)
def voc_segmenter() -> Segmenter | None:
    """Return the published Pascal VOC network; None where its file or its runtime is not there."""
    network = DATA / "weights" / "deeplabv3_mnv2_pascal_quant.tflite"
    with tempfile.TemporaryDirectory() as folder:
        contract = Path(folder) / "voc.json"
        contract.write_text(json.dumps(VOC_CONTRACT))
        try:
            return open_segmenter(network, contract, threads=1)
        except SegmenterError:
            return None


def voc_furniture(image: RelativeImage, plan: ViewPlan | None = None) -> Flags | None:
    """Return furniture as the VOC network sees it through views; None where it cannot be had."""
    segmenter = voc_segmenter()
    if segmenter is None:
        return None
    found = segment_around(image, segmenter, plan=plan or ViewPlan(skip=False), rows=ROWS)
    return resized(found.probabilities[SceneClass.FURNITURE], image.rgb.shape[:2]) > 0.5


def raw_network(evidence: SceneEvidence, shape: tuple[int, int]) -> Flags:
    """Return where the network's likeliest class is furniture: no room, no edges, no floor."""
    found = resized(np.ascontiguousarray(evidence.probabilities.transpose(1, 2, 0)), shape)
    return np.asarray(found.argmax(axis=2) == SceneClass.FURNITURE)


def appearance_outliers(image: RelativeImage, room: RoomModel) -> Flags:
    """Return what differs from the usual colours of the plane behind it; the room is given."""
    shape = (ROWS, 2 * ROWS)
    shown = preview_rgb8(resized(np.asarray(image.rgb), shape))
    maps = surface_maps(room, Equirectangular(shape[1], shape[0]))
    found = np.zeros(shape, bool)
    for plane in np.unique(maps.plane):
        here = (maps.plane == plane) & (maps.opening < 0)
        if plane == CEILING or here.sum() < 100:
            continue
        found |= here & (strangeness(shown, _usual(shown, here)) > 0.5)
    return resized(found.astype(np.float32), image.rgb.shape[:2]) > 0.5


def _usual(shown: npt.NDArray[np.uint8], here: Flags) -> Flags:
    """Return the pixels of the most frequent third of a plane's colours."""
    bins = (shown // 32).astype(np.int32) @ np.array([64, 8, 1])
    counts = np.bincount(bins[here], minlength=512)
    order = np.argsort(-counts)
    enough = np.searchsorted(np.cumsum(counts[order]), counts.sum() / 2) + 1
    return here & np.isin(bins, order[:enough])
