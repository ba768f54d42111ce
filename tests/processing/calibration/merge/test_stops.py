"""Which frames are decoded at all, and that leaving some out is said and costs no more than asked."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest

from benchmarks.photometry.synthetic_bracket import PAPER_TIMES_S, REFERENCE_SENSOR, expose
from processing.calibration.merge.bracket import middle_out
from processing.calibration.merge.merge import MergeOptions, merge
from processing.errors import PictureFileError
from processing.pictures.frames import Codes, Reduce, jpeg_frame
from processing.sphere import Equirectangular
from tests.processing.calibration.merge.merge_cases import NOISE, true_curve


@dataclass
class Counted:
    """A frame that counts how often it is decoded."""

    array: Codes
    name: str
    decoded: int = 0
    depth_bits: int = 8
    linear: bool = False
    reduces: list[int] = field(default_factory=list)

    @property
    def size_px(self) -> tuple[int, int]:
        return self.array.shape[1], self.array.shape[0]

    def decode(self, reduce: Reduce = 1) -> Codes:
        self.decoded += 1
        self.reduces.append(reduce)
        return self.array[::reduce, ::reduce]


def room(low: float, high: float) -> list[Counted]:
    """Return a bracket of luminances low..high cd/m2."""
    cells = np.exp2(np.random.default_rng(5).uniform(np.log2(low), np.log2(high), (30, 60, 1))).astype(np.float32)
    scene = np.repeat(cv2.resize(cells, (240, 120))[..., None], 3, axis=2)
    return [Counted(expose(scene, t, REFERENCE_SENSOR, i), f"f{i}") for i, t in enumerate(PAPER_TIMES_S)]


def test_middle_out_names_all() -> None:
    assert middle_out(5) == [2, 3, 1, 4, 0]
    assert middle_out(1) == [0]


@pytest.mark.parametrize(("low", "high"), [(20.0, 200.0), (2000.0, 20000.0)])
@pytest.mark.parametrize("workers", [1, 3])
def test_frames_that_cannot_add_are_not_decoded_and_the_report_says_why(low: float, high: float, workers: int) -> None:
    frames = room(low, high)
    place = Equirectangular(240, 120)
    options = MergeOptions(workers=workers)
    some = merge(frames, PAPER_TIMES_S, true_curve(), NOISE, geometry=place, options=options)
    left_out = [use for use in some.report.frames if not use.decoded]
    assert len(left_out) >= 3
    assert all(use.reason and use.used_share == 0 for use in left_out)
    assert sum(frame.decoded == 0 for frame in frames) >= len(left_out) - workers
    every = merge(
        room(low, high),
        PAPER_TIMES_S,
        true_curve(),
        NOISE,
        geometry=place,
        options=MergeOptions(quality="reference"),
    )
    grown = some.image.uncertainty / every.image.uncertainty
    assert np.quantile(grown, 0.99) < 1.03
    assert (some.image.validity == 0).all()


def test_a_damaged_frame_is_named() -> None:
    good = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8))[1].tobytes()
    frames = [jpeg_frame(good, "first.jpg"), jpeg_frame(good[:-900] + bytes(898) + good[-2:], "second.jpg")]
    with pytest.raises(PictureFileError, match=r"second\.jpg"):
        merge(frames, [1.0, 0.25], true_curve(), NOISE, geometry=Equirectangular(60, 40))


@pytest.mark.parametrize(("code", "state"), [(255, 1), (0, 2)])
def test_white_and_black_files_are_pictures_too(code: int, state: int) -> None:
    data = cv2.imencode(".jpg", np.full((40, 60, 3), code, np.uint8))[1].tobytes()
    frames = [jpeg_frame(data, f"{i}.jpg") for i in range(3)]
    image = merge(frames, [1.0, 0.25, 1 / 16], true_curve(), NOISE, geometry=Equirectangular(60, 40)).image
    assert (image.validity == state).all()
    assert np.isfinite(image.rgb).all()
