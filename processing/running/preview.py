"""What a changed mask would give, before it is run: the emptied room in seconds, by the stage's own filling.

The picture has the size of a draft (`draft_width_px`); what was hidden is filled at half of that and enlarged, what is
seen stays as sharp as it is. The shade of the old furniture is lifted as the last run found it. Nothing is written to
the session.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Flags, Floats
from processing.ground.seam import resized
from processing.pictures.images import LuminanceImage
from processing.pictures.masks import read_mask
from processing.pipeline import resolve, stage_named
from processing.removal.fill import Quick
from processing.running.artifacts import file_name, load
from processing.running.choices import going_on
from processing.running.fingerprint import visible_part
from processing.running.requests import RunRequest, given_answers, given_files, parameters
from processing.running.results import RESULT_NAME, parse_result
from processing.stages.contract import Quality, StageContext
from processing.stages.detect import LAYERS, drawn_over
from processing.stages.materials import emptied as sunlit_anew
from processing.stages.remove import emptied
from processing.stages.upright import draft_width_px, in_size, mask_in_size, upright_panorama
from station.session.store import load_manifest

LEAST_WORK_PX = 640
"""Width below which the filling is not worked at half size (chosen: a door is then 20 pixels wide)."""
SHADE_ROWS = 128  # of the shade, which is smooth (chosen: half of what a run has)


class Previews:
    """A session's stages as they stand, small and in memory; what has changed on disk is read again."""

    def __init__(self, session: Path) -> None:
        self._session, self._quick = session, Quick()
        self._held: dict[tuple[Path, int], tuple[int, object]] = {}
        self._place = tempfile.TemporaryDirectory(prefix="daylit-preview-")

    def emptied(self) -> LuminanceImage:
        """Return the emptied room (H, W, 3), in the picture's unit, with the session's choices as they are now.

        Raises `ParameterError` where there is nothing to remove, and what the stage raises.
        """
        request = self._request("remove")
        context = self._context(request, 1)
        if reason := resolve(stage_named("remove").skip_rule)(context):
            raise ParameterError("there is nothing to preview", where=self._session.name, likely=reason)
        image = upright_panorama(context)
        work = self._context(request, 2 if image.rgb.shape[1] >= 2 * LEAST_WORK_PX else 1)
        small, (done, _, _) = upright_panorama(work), emptied(work, self._quick)
        return replace(image, rgb=_enlarged(image.rgb, small.rgb, done.image.rgb, done.provenance > 0))

    def sunless(self) -> Flags | None:
        """Return where (H, W) the last run took direct sun away, which falls anew among furniture; None: nowhere."""
        return sunlit_anew(self._context(self._request("materials"), 1)).sunless

    def _request(self, until: str) -> RunRequest:
        with going_on(self._session, {}, RunRequest(until=until, dry_run=True), by="preview") as found:
            return replace(found.request, until=until, quality=Quality.DRAFT)

    def _context(self, request: RunRequest, parts: int) -> StageContext:
        """Return what the stage that is asked for works with at a draft's width divided by ``parts``."""
        row = stage_named(request.until or "remove")
        given = {stage: given_answers(stage_named(stage), request) for stage in row.needs}
        layers = {} if given["detect"] else given_files(stage_named("detect"), request)
        return StageContext(
            session=visible_part(load_manifest(self._session), row.reads),
            session_path=self._session,
            folder=Path(self._place.name),
            parameters=parameters(row, request),
            fetch=lambda stage, name: self._artifact(stage, name, given[stage], parts, layers),
            summary=lambda stage: self._summary(stage, answered=bool(given[stage])),
            quality=Quality.DRAFT,
        )

    def _artifact(
        self, stage: str, name: str, given: Mapping[str, Path], parts: int, layers: Mapping[str, Path]
    ) -> object | None:
        """Return what a stage made, or was given in its place, small, with the layers drawn since over its masks.

        None where it left it out.
        """
        artifact = next(one for one in stage_named(stage).makes if one.name == name)
        path = given.get(name) if given else self._session / "stages" / stage / file_name(artifact)
        found = self._small(path, parts, name, partial(load, artifact)) if path and path.is_file() else None
        drawn = {one: self._small(layers[one], parts, one, read_mask) for one in LAYERS if one in layers}
        if stage != "detect" or not drawn:
            return found
        mask = np.zeros_like(next(iter(drawn.values()))) if found is None else found
        mask = drawn_over(name, mask, [drawn.get(one, np.False_) for one in LAYERS])
        return mask if name == "target" or mask.any() else None

    def _small(self, path: Path, parts: int, name: str, read: Callable[[Path], Any]) -> Any:
        """Return what a file holds at a draft's width divided by ``parts``, as long as it does not change."""
        key, stamp = (path, parts), path.stat().st_mtime_ns
        if self._held.get(key, (0, None))[0] != stamp:
            value = read(path)
            if isinstance(value, LuminanceImage):
                value = in_size(value, draft_width_px(value.rgb.shape[1]) // parts)
            elif isinstance(value, np.ndarray):
                value = mask_in_size(value, draft_width_px(value.shape[1]) // parts)
            elif name == "shade":
                value = _small_shade(path, Path(self._place.name) / "shade.npz")
            self._held[key] = stamp, value
        return self._held[key][1]

    def _summary(self, stage: str, *, answered: bool) -> Mapping[str, Any]:
        try:
            if not answered:
                return parse_result((self._session / "stages" / stage / RESULT_NAME).read_bytes()).summary()
        except (OSError, ValueError):
            pass  # cleaned away, or damaged: a run would make it again
        return {"metrics": {}, "left_out": {}, "warnings": (), "skipped": None}


def _enlarged(rgb: Floats, small: Floats, done: Floats, filled: np.ndarray) -> Floats:
    """Return the picture (H, W, 3) changed as a smaller one was: by its filling, and elsewhere by its ratio."""
    if small.shape == rgb.shape:
        return done
    size = (rgb.shape[0], rgb.shape[1])
    ratio = np.where(filled[..., None], 1, done / np.maximum(small, np.float32(1e-9))).astype(np.float32)
    inside = resized(filled.astype(np.float32), size)[..., None]
    return np.asarray(rgb * resized(ratio, size) * (1 - inside) + resized(done, size) * inside, np.float32)


def _small_shade(path: Path, into: Path) -> Path:
    """Write a run's shade with about `SHADE_ROWS` rows."""
    with np.load(path) as kept:
        step = max(1, kept["seen"].shape[0] // SHADE_ROWS)
        arrays = {name: kept[name][step // 2 :: step, step // 2 :: step] for name in kept.files}
    np.savez(into, **arrays)
    return into
