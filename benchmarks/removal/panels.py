"""Pictures of removal to look at: before with our own mask, Telea in it, ours by the pipeline as it stands, the truth.

``python -m benchmarks.removal.panels penn_bed FOLDER``   the paper's example room; its pictures are not ours to ship:
                                                        name a folder outside the project
``python -m benchmarks.removal.panels lebombo FOLDER``    a real empty flat (CC0) with rendered furniture
``python -m benchmarks.removal.panels room FOLDER``       a simulated room of a validation seed
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from benchmarks.removal.composed import Case
from benchmarks.removal.composites import composites
from benchmarks.removal.real import WHITE_CD_M2, encoded, image_of, penn_bed
from benchmarks.removal.rivals import rivals
from benchmarks.removal.rooms import MIDDLE
from benchmarks.truth_rooms import kept_list, truth_of
from processing.ground.arrays import Bytes, Flags, Floats
from processing.pictures.exr import read_exr, write_exr
from processing.pictures.images import luminance_cd_m2
from processing.pictures.preview import read_mask
from processing.running.panorama_session import panorama_session
from processing.running.requests import RunRequest
from processing.running.runner import process

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
    image, _, _, theirs = penn_bed()
    before = np.ascontiguousarray(encoded(image.rgb / WHITE_CD_M2))
    hole, ours = emptied(image.rgb)
    telea = rivals(slow=False)["opencv_telea"](before, hole)
    shown = encoded(ours / WHITE_CD_M2)
    return {MASKED: marked(before, hole), "the authors' result": theirs, "OpenCV Telea": telea, "daylit": shown}


def lebombo() -> dict[str, Bytes]:
    """Return the real flat with rendered furniture."""
    case = Case(next(iter(composites(1))))
    return _four(case.one.furnished, case.scale, case.shown)


def simulated() -> dict[str, Bytes]:
    """Return a simulated room of a validation seed."""
    _, truth = truth_of(*kept_list("validation", 1)[0])
    scale = MIDDLE / float(np.median(luminance_cd_m2(truth.empty_rgb)))
    return _four(truth.luminance_rgb, scale, encoded(truth.empty_rgb * scale))


def emptied(rgb: Floats) -> tuple[Flags, Floats]:
    """Return the mask (H, 2 H) and the emptied picture (H, 2 H, 3), in the unit of ``rgb``, by layout, masks and light
    of our own.
    """
    with tempfile.TemporaryDirectory() as folder:
        write_exr(Path(folder) / "furnished.exr", image_of(rgb))
        session = panorama_session(Path(folder) / "furnished.exr", Path(folder) / "session")
        process(session, RunRequest(until="remove", options={"--doubtful-room": True}))
        stages = session / "stages"
        given, done = (read_exr(stages / one).rgb for one in ("calibrate/indoor.exr", "remove/empty.exr"))
        hole = read_mask(stages / "detect" / "target.png")
    return hole, done * np.float32(np.median(rgb) / np.median(given))


def _four(furnished: Floats, scale: float, truth: Bytes) -> dict[str, Bytes]:
    before = np.ascontiguousarray(encoded(furnished * scale))
    hole, ours = emptied(furnished)
    telea = rivals(slow=False)["opencv_telea"](before, hole)
    return {MASKED: marked(before, hole), "OpenCV Telea": telea, "daylit": encoded(ours * scale), "truly empty": truth}


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
