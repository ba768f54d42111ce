"""Hostile brackets merged as the product merges them: pictures with a curve, and raw files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.hostile.worlds import HostileBracket
from processing.calibration.merge.merge import Merged, MergeOptions, merge
from processing.calibration.response.linear import fit_linear
from processing.calibration.response.response import ResponseFit
from processing.ground.arrays import Bytes, UInt16s
from processing.pictures.frames import RawFrame, array_frame, raw_frame
from processing.pictures.images import RelativeImage
from processing.pictures.mosaic import FULL, PEDESTAL
from processing.sphere import Equirectangular, Geometry


def merged_pictures(frames: Sequence[Bytes], geometry: Geometry, fit: ResponseFit, **options: Any) -> RelativeImage:
    """Return frames (H, W, 3) of 8 bits merged with a curve and times that were recovered from a bracket."""
    sources = [array_frame(frame, f"frame {k}") for k, frame in enumerate(frames)]
    known = {"geometry": geometry, "options": MergeOptions(own_curve=True), "time_sigma": fit.time_sigma}
    return merge(sources, fit.times_s, fit.curve, fit.noise, **known, **options).image


def merged_raws(bracket: HostileBracket) -> tuple[Merged, list[RawFrame], list[UInt16s]]:
    """Return a bracket's raw files merged, and the files and their codes (H, W, 3)."""
    files = [raw_frame(data, f"frame {k}") for k, data in enumerate(bracket.raw)]
    codes = [np.asarray(file.decode(), np.uint16) for file in files]
    fit = fit_linear(codes, bracket.nominal_s, PEDESTAL / FULL)
    merged = merge(
        [array_frame(code, file.name) for code, file in zip(codes, files, strict=True)],
        fit.times_s,
        None,
        fit.noise,
        geometry=Equirectangular(*files[0].size_px),
        options=MergeOptions(own_curve=True, colours=files[0].colours),
        time_sigma=fit.time_sigma,
        given_s=bracket.nominal_s,
    )
    return merged, files, codes
