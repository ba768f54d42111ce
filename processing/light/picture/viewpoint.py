"""The room from another place: what the camera saw stays as it saw it, the rest is rendered and marked.

A surface's light towards the camera is taken as its light towards everybody (true of matte surfaces; a highlight stays
where the camera saw it). What the camera did not see is the scene's albedo under the scene's light, brought to the
level of what is seen around it on the same surface.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from processing.errors import ViewpointError
from processing.ground.arrays import Doubles, Flags, Floats, Vector
from processing.ground.polygons import inside
from processing.light.picture.render import render
from processing.light.scene.scene import Part, Scene, Surface
from processing.light.solver.irradiance import EFFORTS, Effort
from processing.light.solver.sight import GLASS, Sight, own_pixels, sight_of
from processing.light.solver.stage import Stage, in_parts
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular, Perspective

SAME_PLACE_M, SAME_PLACE = 0.01, 0.004
"""How far before a place a ray from the camera may end and still see it: metres, and of its length."""
GRAZING = 0.05  # cosine under which the camera saw a place too flatly to show its light
MOST_GAIN = 2.5  # 1.3 stops; chosen, never swept
_SIGMAS_PX = (4.0, 16.0, 64.0, 256.0)
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS, np.float32)


@dataclass(frozen=True)
class Elsewhere:
    """A picture from another place than the camera's."""

    rgb: Floats
    """(H, W, 3) cd/m2."""
    seen: Flags
    """(H, W): what the camera saw too."""
    glass: Flags
    """(H, W): what is seen through a window, from the picture of the outdoors."""
    error: float
    """Relative standard error of the irradiance of what is rendered."""


def seen_from(
    scene: Scene,
    photograph: Floats,
    camera_m: Vector,
    geometry: Equirectangular | Perspective,
    eye_m: Vector,
    *,
    effort: Effort = EFFORTS["draft"],
    seed: int = 0,
) -> Elsewhere:
    """Return what is seen from ``eye_m``; ``photograph`` (H, 2 H, 3) shows the scene from ``camera_m``.

    Raises `ViewpointError`: the place is outside of the room, or within a piece of furniture.
    """
    check_place(scene, eye_m)
    stage = Stage.of(scene, effort.texel_m)
    rendered = render(stage, geometry, eye_m, effort=effort, seed=seed)
    sight = sight_of(stage, geometry, eye_m)
    shown, known = _as_photographed(stage, photograph, camera_m, sight)
    gain = _gains(shown, rendered.rgb.reshape(-1, 3), known, sight)
    flat = np.where(known[:, None], shown, rendered.rgb.reshape(-1, 3) * gain)
    shape = sight.shape
    glass = (sight.label == GLASS).reshape(shape)
    return Elsewhere(flat.reshape(*shape, 3).astype(np.float32), known.reshape(shape), glass, rendered.error)


def _as_photographed(stage: Stage, photograph: Floats, camera_m: Vector, sight: Sight) -> tuple[Floats, Flags]:
    """Return the photograph's light (N, 3) of what pixels see, and which of them it shows."""
    rows = photograph.shape[0]
    camera = np.asarray(camera_m, np.float32)
    way = sight.point - camera
    far = np.linalg.norm(way, axis=1)
    way = (way / np.maximum(far, 1e-6)[:, None]).astype(np.float32)
    facing = -np.einsum("ij,ij->i", way, sight.normal)
    known = sight.solid & (facing > GRAZING) & (far > 1e-3)
    chosen = np.flatnonzero(known)
    for part in (chosen[some] for some in in_parts(len(chosen))):
        hits = stage.tracer.cast(np.broadcast_to(camera, way[part].shape), way[part])
        known[part] = hits.distance_m > far[part] * (1 - SAME_PLACE) - SAME_PLACE_M
    own = sight_of(stage, Equirectangular(2 * rows, rows), camera_m).label.reshape(rows, 2 * rows)
    chosen = np.flatnonzero(known)
    value, weight = own_pixels(photograph, own, way[chosen], sight.label[chosen], least=1e-4)
    out = np.zeros((len(known), 3), np.float32)
    out[chosen] = value
    known[chosen] = weight > 0
    return out, known


def _gains(shown: Floats, rendered: Floats, known: Flags, sight: Sight) -> Floats:
    """Return by what (N, 1) rendered pixels are brought to the level of what is seen around them on their surface."""
    level = np.log(np.maximum(shown @ _WEIGHTS, 1e-6) / np.maximum(rendered @ _WEIGHTS, 1e-6))
    level = np.clip(level, -np.log(MOST_GAIN), np.log(MOST_GAIN)).astype(np.float32).reshape(sight.shape)
    known, labels = known.reshape(sight.shape), sight.label.reshape(sight.shape)
    out = np.zeros(sight.shape, np.float32)
    usual = float(np.median(level[known])) if known.any() else 0.0
    for label in np.unique(sight.label[sight.solid & ~known.ravel()]):
        mine = labels == label
        rows, columns = (np.flatnonzero(mine.any(axis=axis)) for axis in (1, 0))
        box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        todo, own = mine[box], (mine & known)[box].astype(np.float32)
        out[mine] = float(np.median(level[mine & known])) if own.any() else usual
        for sigma in _SIGMAS_PX if own.any() else ():
            share, mean = (cv2.GaussianBlur(one, (0, 0), sigma) for one in (own, own * level[box]))
            ready = todo & (share > 0.02)
            out[box][ready] = mean[ready] / share[ready]
            todo = todo & ~ready
            if not todo.any():
                break
    return np.exp(out.reshape(-1, 1))


def check_place(scene: Scene, eye_m: Vector) -> None:
    """Raise `ViewpointError` for a place outside of the room or within furniture, which it names."""
    eye = np.asarray(eye_m, np.float64)
    where = f"({eye[0]:g}, {eye[1]:g}, {eye[2]:g}) m"
    if not np.isfinite(eye).all():
        raise ViewpointError("a position that is not a number", advice="give X,Y,Z in metres")
    low, high = (next((s for s in scene.surfaces if s.name == name), None) for name in ("floor", "ceiling"))
    if low is not None and not _over(low, eye):
        raise ViewpointError("outside the room", where=where, advice="the camera stands at 0,0; give metres from it")
    floor_m = low.origin_m[2] if low is not None else -np.inf
    ceiling_m = high.origin_m[2] if high is not None else np.inf
    if not floor_m < eye[2] < ceiling_m:
        text = f"above the ceiling or below the floor: heights go from {floor_m:g} to {ceiling_m:.2f} m"
        raise ViewpointError(text, where=where)
    for name, parts in _items(scene).items():
        if abs(sum(_winding(part, eye) for part in parts)) > 0.5:
            raise ViewpointError(f"within {name}", where=where, advice="choose a viewpoint beside it")


def _over(floor: Surface, eye: Doubles) -> bool:
    offset = eye - floor.origin_m
    return bool(inside(floor.outline_m, np.array([[offset @ floor.u_axis, offset @ floor.v_axis]]))[0])


def _items(scene: Scene) -> dict[str, list[Part]]:
    found: dict[str, list[Part]] = {}
    for part in scene.parts:
        found.setdefault(part.name.split(":")[0], []).append(part)
    return found


def _winding(part: Part, eye: Doubles) -> float:
    """Return how often a mesh surrounds a place: 1 within a closed one (Van Oosterom, Strackee 1983)."""
    a, b, c = (part.vertices_m[part.faces[:, k]] - eye for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2(above, below).sum() / (2 * np.pi))
