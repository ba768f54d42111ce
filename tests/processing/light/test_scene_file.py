"""A scene in a file: the same back, the same bytes, damage named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from processing.errors import SceneError
from processing.light.scene.scene import Sun
from processing.light.scene.scene_file import read_scene, write_scene
from tests.processing.light.rooms import box, box_room, scene_of, uniform_sky

SUN = Sun((0.0, -0.6, 0.8), (7e4, 6.5e4, 6e4))


def scene():
    part = box(
        (1.0, 0.5, 0.4), (0.8, 0.8, 0.8), roughness=0.3, metallic=1.0, texture=np.full((2, 3, 3), 0.5, np.float32)
    )
    return scene_of(box_room(), uniform_sky(1000.0, SUN), 0.4, reveal_m=0.2).furnished((part,))


def test_it_comes_back_as_it_was(tmp_path: Path) -> None:
    one = scene()
    write_scene(tmp_path / "a.npz", one)
    write_scene(tmp_path / "b.npz", one)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    back = read_scene(tmp_path / "a.npz")
    assert back.outdoors.sun == SUN
    assert np.array_equal(back.outdoors.rgb, one.outdoors.rgb)
    assert [s.name for s in back.surfaces] == [s.name for s in one.surfaces]
    assert back.surfaces[2].holes_m == one.surfaces[2].holes_m
    assert np.array_equal(back.panes[0].clear, one.panes[0].clear)
    assert back.parts[0].material.metallic == 1.0
    assert np.array_equal(back.parts[0].material.texture, one.parts[0].material.texture)
    assert back.parts[0].normals is None


@pytest.mark.parametrize("keep", [0, 100, 0.5, 0.98])
def test_what_is_damaged_is_named(tmp_path: Path, keep: float) -> None:
    path = tmp_path / "scene.npz"
    write_scene(path, scene())
    data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data)) if keep < 1 else int(keep)])
    with pytest.raises(SceneError, match=r"scene\.npz"):
        read_scene(path)


def test_other_arrays_are_no_scene(tmp_path: Path) -> None:
    path = tmp_path / "scene.npz"
    with path.open("wb") as file:
        np.savez(file, other=np.zeros(3))
    with pytest.raises(SceneError, match="not a scene file"):
        read_scene(path)
