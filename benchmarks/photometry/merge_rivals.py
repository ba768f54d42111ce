"""Rivals of the merge: OpenCV's Debevec and Robertson, colour-hdri, HDRutils; all take the same frames and times."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from processing.calibration.response.curve import ResponseCurve
from processing.ground.arrays import Floats

Frames = Sequence[npt.NDArray[np.uint8]]
ROBERTSON_STEP_PX = 8
"""OpenCV's Robertson calibration looks at all pixels and takes minutes; every 8th gives the same curve."""
COLOUR_HDRI_SAMPLES = 120
"""Given to colour-hdri, which takes some seconds even so."""


def opencv_response(curve: ResponseCurve) -> Floats:
    """Return a curve as OpenCV takes it: (256, 1, 3) linear exposure."""
    return np.ascontiguousarray(curve.exposure.T[:, None, :], dtype=np.float32)


def debevec_merge(frames: Frames, times_s: Sequence[float], response: Floats) -> Floats:
    """Merge with a given response."""
    return np.asarray(cv2.createMergeDebevec().process(list(frames), np.float32(times_s), response))


def robertson_merge(frames: Frames, times_s: Sequence[float], response: Floats) -> Floats:
    """Merge with a given response."""
    return np.asarray(cv2.createMergeRobertson().process(list(frames), np.float32(times_s), response))


def table_merge(frames: Frames, times_s: Sequence[float], response: Floats) -> Floats:
    """Merge by a table a frame and weights of inverse variance: the least that a careful person would write."""
    code = np.arange(256)
    usable = ((code > 4) & (code < 251)).astype(np.float32)
    # Shot noise: a code's variance grows with its exposure; in light that is exposure / time squared.
    total, weights = np.zeros(frames[0].shape, np.float32), np.full(frames[0].shape, 1e-12, np.float32)
    for frame, time_s in zip(frames, times_s, strict=True):
        weight = usable[:, None] * np.float32(time_s) ** 2 / (response[:, 0] + np.float32(1e-4))
        light = response[:, 0] / np.float32(time_s) * weight
        weights += cv2.LUT(frame, np.ascontiguousarray(weight[None], np.float32))
        total += cv2.LUT(frame, np.ascontiguousarray(light[None], np.float32))
    return np.asarray(total / weights)


def debevec(frames: Frames, times_s: Sequence[float]) -> Floats:
    """Calibrate by OpenCV's default and merge."""
    response = cv2.createCalibrateDebevec().process(list(frames), np.float32(times_s))
    return debevec_merge(frames, times_s, response)


def robertson(frames: Frames, times_s: Sequence[float]) -> Floats:
    """Calibrate on every 8th pixel and merge."""
    few = [np.ascontiguousarray(f[::ROBERTSON_STEP_PX, ::ROBERTSON_STEP_PX]) for f in frames]
    response = cv2.createCalibrateRobertson().process(few, np.float32(times_s))
    return robertson_merge(frames, times_s, response)


def colour_hdri(frames: Frames, times_s: Sequence[float]) -> Floats:
    """Calibrate (Grossberg's samples, Debevec's curves) and merge."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour_hdri as hdri

        stack = hdri.ImageStack()
        # It takes the first frame for the darkest.
        for frame, time_s in sorted(zip(frames, times_s, strict=True), key=lambda one: one[1]):
            metadata = hdri.Metadata(f_number=np.array(5.6), exposure_time=np.array(time_s), iso=np.array(100))
            stack.append(hdri.Image(data=frame.astype(np.float64) / 255, metadata=metadata))
        curves = hdri.camera_response_functions_Debevec1997(
            stack,
            sampling_function=hdri.samples_Grossberg2003,
            sampling_function_kwargs={"samples": COLOUR_HDRI_SAMPLES},
        )
        return np.asarray(hdri.image_stack_to_HDRI(stack, camera_response_functions=curves), dtype=np.float32)


ALL: dict[str, Callable[[Frames, Sequence[float]], Any]] = {
    "opencv_debevec": debevec,
    "opencv_robertson": robertson,
}
SMALL: dict[str, Callable[[Frames, Sequence[float]], Any]] = {"colour_hdri": colour_hdri}
