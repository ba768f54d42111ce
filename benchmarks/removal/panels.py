"""Pictures of removal to look at: before with mask, Telea, ours, and the truth or the paper authors' own result.

``python -m benchmarks.removal.panels penn_bed FOLDER``   the paper's example room; its pictures are not ours to ship:
                                                        name a folder outside the project
``python -m benchmarks.removal.panels lebombo FOLDER``    a real empty flat (CC0) with rendered furniture
``python -m benchmarks.removal.panels room FOLDER``       a simulated room of a validation seed
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.removal.composed import Case
from benchmarks.removal.composites import composites
from benchmarks.removal.real import WHITE_CD_M2, encoded, image_of, penn_bed
from benchmarks.removal.rivals import rivals
from benchmarks.removal.rooms import MIDDLE, target_of
from benchmarks.truth_rooms import kept_list, room_model_of, truth_of
from processing.ground.arrays import Bytes, Flags
from processing.pictures.images import luminance_cd_m2
from processing.removal.fill import empty_room

WIDTH_PX, BAND_PX = 760, 22
TOP, BOTTOM = 0.12, 0.94
"""Of the rows that are shown: poles are left out."""
MASKED = "before, what is to go in red"
RED = np.array([0, 0, 200], np.float64)


def marked(picture: Bytes, mask: Flags) -> Bytes:
    """Return the picture with the mask in red."""
    out = picture.copy()
    out[mask] = (0.5 * picture[mask] + 0.5 * RED).astype(np.uint8)
    return out


def panel(pictures: dict[str, Bytes]) -> Bytes:
    """Return the pictures in two columns, each with its name."""
    made = []
    for name, picture in pictures.items():
        rows = slice(int(TOP * len(picture)), int(BOTTOM * len(picture)))
        shown = np.ascontiguousarray(picture[rows])
        size = (WIDTH_PX, round(WIDTH_PX * shown.shape[0] / shown.shape[1]))
        small = cv2.resize(shown, size, interpolation=cv2.INTER_AREA)
        cv2.rectangle(small, (0, 0), (size[0], BAND_PX), (30, 30, 30), -1)
        cv2.putText(small, name, (8, BAND_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
        made.append(small)
    return np.vstack([np.hstack(made[i : i + 2]) for i in range(0, len(made), 2)])


def penn() -> dict[str, Bytes]:
    """Return the paper's example room."""
    image, room, target, theirs = penn_bed()
    before = np.ascontiguousarray(encoded(image.rgb / WHITE_CD_M2))
    ours = encoded(empty_room(image, target, room).image.rgb / WHITE_CD_M2)
    telea = rivals(slow=False)["opencv_telea"](before, target)
    return {MASKED: marked(before, target), "the authors' result": theirs, "OpenCV Telea": telea, "daylit": ours}


def lebombo() -> dict[str, Bytes]:
    """Return the real flat with rendered furniture."""
    case = Case(next(iter(composites(1))))
    before, hole = np.ascontiguousarray(encoded(case.one.furnished * case.scale)), case.hole()
    ours = empty_room(image_of(case.one.furnished), hole, case.one.room, sunlight=case.masks().sunlight).image.rgb
    return _four(before, hole, encoded(ours * case.scale), case.shown)


def simulated() -> dict[str, Bytes]:
    """Return a simulated room of a validation seed."""
    number, use = kept_list("validation", 1)[0]
    room, truth = truth_of(number, use)
    target, scale = target_of(truth), MIDDLE / float(np.median(luminance_cd_m2(truth.empty_rgb)))
    before = np.ascontiguousarray(encoded(truth.luminance_rgb * scale))
    ours = empty_room(image_of(truth.luminance_rgb), target, room_model_of(room)).image.rgb
    return _four(before, target, encoded(ours * scale), encoded(truth.empty_rgb * scale))


def _four(before: Bytes, hole: Flags, ours: Any, truth: Any) -> dict[str, Bytes]:
    telea = rivals(slow=False)["opencv_telea"](before, hole)
    return {MASKED: marked(before, hole), "OpenCV Telea": telea, "daylit": ours, "truly empty": truth}


def main(name: str, folder: Path) -> None:
    """Write one panel."""
    if name == "penn_bed" and Path(__file__).resolve().parents[2] in folder.resolve().parents:
        sys.exit("penn_bed may not be copied into the project: name a folder outside it")
    made = {"penn_bed": penn, "lebombo": lebombo, "room": simulated}[name]()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"removal-{name}.jpg"
    cv2.imwrite(str(path), panel(made), [cv2.IMWRITE_JPEG_QUALITY, 85])
    print(path)


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in ("penn_bed", "lebombo", "room"):
        sys.exit("give penn_bed, lebombo or room, and a folder")
    main(sys.argv[1], Path(sys.argv[2]))
