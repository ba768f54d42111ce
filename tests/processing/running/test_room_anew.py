"""A corrected room estimated again: by what the first estimate was made of."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from processing.ground.room_model import write_room
from processing.pictures.images import LuminanceImage
from processing.running import room_anew
from processing.segmentation.evidence import write_evidence
from processing.sphere import Equirectangular
from tests.processing.room.evidence import BOX, evidence_of, room_of

SUN = (0.3, 0.5)


@pytest.mark.parametrize(
    ("square", "found", "azimuth_deg", "sun", "networks"),
    [
        (0.9, "yes, 30.00 degrees high", 12.0, SUN, 2),
        (0.1, "no: overcast", None, None, 2),
        (0.9, "no: overcast", 12.0, None, 1),
    ],
)
def test_a_new_estimate_is_made_of_what_the_first_one_was(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    square: float,
    found: str,
    azimuth_deg: float | None,
    sun: tuple[float, float] | None,
    networks: int,
) -> None:
    """The azimuth only where edges show one, our network's classes for the shape, the sun only where it shone.

    With a network from a file in the place of ours, which is fused with none, openings too come from our classes.
    """
    stages, room = tmp_path / "stages", room_of(BOX)
    for name in ("room", "calibrate"):
        (stages / name).mkdir(parents=True)
    ours = evidence_of(room)
    both = replace(
        ours, probabilities=np.full_like(ours.probabilities, 1 / 8), own=ours.probabilities, networks=networks
    )
    write_evidence(stages / "room" / "evidence.npz", both)
    write_room(stages / "room" / "room.json", room)
    metrics = {"walls_azimuth_deg": 12.0, "walls_square": square}
    (stages / "room" / "result.json").write_text(json.dumps({"metrics": metrics}))
    (stages / "calibrate" / "calibration.json").write_text(json.dumps({"outdoor": {"sun": {"found": found}}}))
    flat = np.full((64, 128), 0.02, np.float32), np.zeros((64, 128), np.uint8), Equirectangular(128, 64), 0.02
    picture, asked = LuminanceImage(np.ones((64, 128, 3), np.float32), *flat), list[Any]()

    def estimate(_image: object, evidence: Any, **how: Any) -> SimpleNamespace:
        asked.append((evidence.probabilities, how["manhattan_rad"]))
        return SimpleNamespace(room=room)

    def openings(_image: object, evidence: Any, _room: object, towards: object, **_how: object) -> tuple[()]:
        asked.append((evidence.probabilities, towards))
        return ()

    changed = {"picture_of": lambda *_: tmp_path, "read_exr": lambda _: picture, "estimate_room": estimate}
    changed |= {"find_openings_in_sun": openings, "load_manifest": lambda _: None, "sun_direction": lambda _: SUN}
    for name, what in changed.items():
        monkeypatch.setattr(room_anew, name, what)
    assert room_anew.room_around(tmp_path, room).floor == room.floor
    (shape, azimuth), (windows, towards) = asked
    np.testing.assert_allclose(shape, ours.probabilities, atol=1e-3)
    np.testing.assert_allclose(windows, (both if networks > 1 else ours).probabilities, atol=1e-3)
    assert (azimuth, towards) == (None if azimuth_deg is None else pytest.approx(math.radians(azimuth_deg)), sun)
