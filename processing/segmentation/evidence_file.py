"""Scene evidence on disk: one compressed NumPy archive without pickles, probabilities in half precision."""

from __future__ import annotations

import io
import json
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

from processing.errors import SegmenterError
from processing.picture_writing import write_bytes
from processing.segmentation.classes import SceneClass
from processing.segmentation.evidence import BoundaryEvidence, SceneEvidence

FORMAT = 1
_BOUNDARY = ("ceiling_rad", "floor_rad", "ceiling_sigma_rad", "floor_sigma_rad", "corner")
LARGEST_PIXELS = 8 << 20


_DAMAGED = (OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError, SyntaxError)
"""What reading a damaged archive raises, beside errors of its parts."""


def write_evidence(path: Path, evidence: SceneEvidence) -> None:
    """Write evidence; probabilities are kept to about three digits."""
    facts = {
        "format": FORMAT,
        "source": evidence.source,
        "views_used": evidence.views_used,
        "views_skipped": evidence.views_skipped,
        "notes": list(evidence.notes),
    }
    arrays = {"probabilities": evidence.probabilities.astype(np.float16)}
    if evidence.boundary is not None:
        arrays |= {name: np.asarray(getattr(evidence.boundary, name)) for name in _BOUNDARY}
    out = io.BytesIO()
    np.savez_compressed(out, allow_pickle=False, facts=np.array(json.dumps(facts)), **arrays)
    write_bytes(path, out.getvalue())


def read_evidence(path: Path) -> SceneEvidence:
    """Read what `write_evidence` wrote.

    Raises
    ------
    SegmenterError
        The file is missing, damaged, or holds what evidence cannot be.
    """
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            facts = json.loads(str(file["facts"]))
            found = file["probabilities"].astype(np.float32)
            boundary = {name: file[name] for name in _BOUNDARY} if "floor_rad" in file.files else None
        if facts["format"] != FORMAT or found.ndim != 3 or found.shape[0] != len(SceneClass):
            raise SegmenterError("is not evidence of this version", where=str(path), advice="make it anew")
        if found[0].size > LARGEST_PIXELS or not np.isfinite(found).all():
            raise SegmenterError("holds probabilities that cannot be", where=str(path), advice="make it anew")
        return SceneEvidence(
            probabilities=found / np.maximum(found.sum(axis=0), 1e-3),
            source=str(facts["source"]),
            boundary=None if boundary is None else _boundary(boundary),
            views_used=int(facts["views_used"]),
            views_skipped=int(facts["views_skipped"]),
            notes=tuple(str(note) for note in facts["notes"]),
        )
    except (*_DAMAGED, zipfile.BadZipFile, zlib.error, tokenize.TokenError) as exc:
        raise SegmenterError(f"evidence cannot be read: {exc!r}"[:300], where=str(path), advice="make it anew") from exc


def _boundary(arrays: dict[str, np.ndarray]) -> BoundaryEvidence:
    doubles = {name: np.asarray(arrays[name], np.float64) for name in _BOUNDARY[:4]}
    return BoundaryEvidence(**doubles, corner=np.asarray(arrays["corner"], np.float32))
