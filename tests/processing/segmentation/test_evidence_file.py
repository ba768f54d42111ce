from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processing.errors import SegmenterError
from processing.segmentation.evidence import read_evidence, write_evidence
from tests.processing.room.evidence import BOX, evidence_of, room_of


@pytest.mark.parametrize("with_boundary", [True, False])
def test_evidence_reads_back(tmp_path: Path, with_boundary: bool) -> None:
    made = replace(evidence_of(room_of(BOX)), views_used=4, views_skipped=1, notes=("a note",))
    reach = np.full(made.probabilities.shape[1:], 2.5, np.float32)
    details = {"reach": reach, "skirting": reach / 5, "own": made.probabilities[:, ::2, ::2]}
    made = replace(made, **details) if with_boundary else replace(made, boundary=None)
    path = tmp_path / "evidence.npz"
    write_evidence(path, made)
    found = read_evidence(path)
    assert (found.source, found.views_used, found.views_skipped, found.notes) == ("made by hand", 4, 1, ("a note",))
    np.testing.assert_allclose(found.probabilities, made.probabilities, atol=1e-3)
    np.testing.assert_allclose(found.probabilities.sum(axis=0), 1, atol=1e-5)
    if made.boundary is None:
        assert found.boundary is found.reach is found.skirting is found.own is None
    else:
        assert found.boundary is not None
        np.testing.assert_array_equal(found.boundary.floor_rad, made.boundary.floor_rad)
        np.testing.assert_array_equal(found.boundary.corner, made.boundary.corner)
        np.testing.assert_array_equal(found.reach, reach)
        np.testing.assert_array_equal(found.skirting, reach / 5)
        np.testing.assert_allclose(found.own, made.own, atol=1e-3)


def test_the_same_evidence_makes_the_same_file(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        write_evidence(tmp_path / name, evidence_of(room_of(BOX)))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize("damage", ["cut", "junk", "empty", "other", "none"])
def test_damaged_files_are_named(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "evidence.npz"
    write_evidence(path, evidence_of(room_of(BOX)))
    whole = path.read_bytes()
    if damage == "none":
        path.unlink()
    elif damage == "other":
        np.savez(path, something=np.zeros(3))
    else:
        path.write_bytes({"cut": whole[: len(whole) // 2], "junk": b"PK\x03\x04 junk", "empty": b""}[damage])
    with pytest.raises(SegmenterError, match=r"evidence\.npz"):
        read_evidence(path)
