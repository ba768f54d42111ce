"""Evidence that networks and image analysis give on a panorama, in one form whatever its source."""

import io
import json
import tokenize
import zipfile
import zlib
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np

from processing.errors import SegmenterError
from processing.ground.arrays import Doubles, Floats
from processing.pictures.writing import write_bytes


class SceneClass(IntEnum):
    """What a pixel shows, as far as room and removal need to know; also the channel of `SceneEvidence`."""

    FLOOR = 0
    """Rugs lie on it and are FIXTURE."""
    WALL = 1
    """With skirting, columns and reveals."""
    CEILING = 2
    WINDOW = 3
    """Glass, frame and what is seen through it; glass doors too."""
    DOOR = 4
    """Leaf and frame; an open doorway and what is seen through it."""
    FURNITURE = 5
    """What is to be removed: whatever stands on the floor, and clutter on it."""
    FIXTURE = 6
    """What stays: built-ins, radiators, curtains, blinds, rugs, pictures, mirrors, lamps on ceiling and wall."""
    TRIPOD = 7
    """The photographer's own: tripod, its shadowless foot, meter board."""


@dataclass(frozen=True)
class BoundaryEvidence:
    """Where walls meet floor and ceiling, behind furniture too, per column of an upright panorama.

    Column i of n looks at longitude ((i + 0.5) / n - 0.5) * 2 pi. Latitudes in radians, up positive.
    """

    ceiling_rad: Doubles
    """(N,), > 0."""
    floor_rad: Doubles
    """(N,), < 0."""
    ceiling_sigma_rad: Doubles
    """(N,): standard uncertainty."""
    floor_sigma_rad: Doubles
    corner: Floats
    """(N,), 0..1: how likely a vertical corner of the room (seen or hidden) lies in this column."""


@dataclass(frozen=True)
class SceneEvidence:
    """Class probabilities of every pixel of an upright equirectangular panorama, and its boundaries if known."""

    probabilities: Floats
    """(len(SceneClass), H, W), each pixel sums to 1; uniform where nothing is known."""
    source: str
    """Network's name and version, or file."""
    boundary: BoundaryEvidence | None = None
    views_used: int = 0
    views_skipped: int = 0
    notes: tuple[str, ...] = ()
    networks: int = 1
    """How many networks the probabilities are the mean of."""
    reach: Floats | None = None
    """(H, W): estimated distance from the camera to what is seen, in camera heights."""
    skirting: Floats | None = None
    """(H, W), 0..1: how much of a pixel is skirting that is seen."""
    own: Floats | None = None
    """(len(SceneClass), h, w): what our network says alone, where the probabilities are (also) another's."""

    def share(self, *classes: SceneClass) -> Floats:
        """Return the summed probability (H, W) of some classes."""
        return np.asarray(self.probabilities[list(classes)].sum(axis=0), dtype=np.float32)


BEYOND = 1.5
"""Times the distance of a wall, from which what is seen is beyond an opening (chosen; 1.4 is `SceneEvidence.reach`'s
error)."""
FORMAT = 2  # raised when arrays that a reader needs change
_BOUNDARY = ("ceiling_rad", "floor_rad", "ceiling_sigma_rad", "floor_sigma_rad", "corner")
_DETAILS = ("reach", "skirting", "own")
LARGEST_PIXELS = 8 << 20
_DAMAGED = (OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError, SyntaxError)
"""What reading a damaged archive raises, beside errors of its parts."""


def write_evidence(path: Path, evidence: SceneEvidence) -> None:
    """Write evidence: a compressed NumPy archive without pickles, probabilities in half precision."""
    names = ("source", "views_used", "views_skipped", "notes", "networks")
    facts = {"format": FORMAT, **{name: getattr(evidence, name) for name in names}}
    arrays = {"probabilities": evidence.probabilities.astype(np.float16)}
    if evidence.boundary is not None:
        arrays |= {name: np.asarray(getattr(evidence.boundary, name)) for name in _BOUNDARY}
    arrays |= {name: one.astype(np.float16) for name in _DETAILS if (one := getattr(evidence, name)) is not None}
    out = io.BytesIO()
    np.savez_compressed(out, allow_pickle=False, facts=np.array(json.dumps(facts)), **arrays)
    write_bytes(path, out.getvalue())


def read_evidence(path: Path) -> SceneEvidence:
    """Read what `write_evidence` wrote.

    Raises `SegmenterError`: the file is missing, damaged, or holds what evidence cannot be.
    """
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            facts = json.loads(str(file["facts"]))
            found = file["probabilities"].astype(np.float32)
            boundary = {name: file[name] for name in _BOUNDARY} if "floor_rad" in file.files else None
            details = {name: file[name].astype(np.float32) for name in _DETAILS if name in file.files}
        if facts["format"] != FORMAT or found.ndim != 3 or found.shape[0] != len(SceneClass):
            raise SegmenterError("was written by another version of daylit", where=str(path), advice="rebuild it")
        own = details.get("own", found)
        fit = own.ndim == 3 and len(own) == len(found) and np.isfinite(own).all() and np.isfinite(found).all()
        if found[0].size > LARGEST_PIXELS or not fit:
            raise SegmenterError("holds invalid probabilities", where=str(path), advice="rebuild it")
        return SceneEvidence(
            probabilities=found / np.maximum(found.sum(axis=0), 1e-3),
            source=str(facts["source"]),
            boundary=None if boundary is None else _boundary(boundary),
            views_used=int(facts["views_used"]),
            views_skipped=int(facts["views_skipped"]),
            notes=tuple(str(note) for note in facts["notes"]),
            networks=int(facts["networks"]),
            **details,
        )
    except (*_DAMAGED, zipfile.BadZipFile, zlib.error, tokenize.TokenError) as exc:
        raise SegmenterError(f"evidence cannot be read: {exc!r}"[:300], where=str(path), advice="rebuild it") from exc


def _boundary(arrays: dict[str, np.ndarray]) -> BoundaryEvidence:
    doubles = {name: np.asarray(arrays[name], np.float64) for name in _BOUNDARY[:4]}
    return BoundaryEvidence(**doubles, corner=np.asarray(arrays["corner"], np.float32))
