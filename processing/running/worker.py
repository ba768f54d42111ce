"""A warm program: ``python -m processing.running.worker FOLDER`` keeps pictures and light of its last session at hand.

A request is a line of JSON on standard input ({"session": name, "do": name, ...}), an answer a line of JSON and as many
bytes as its "bytes" says. It ends with its input. Nothing is written to the session but the basis of its light.
"""

import gc
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DaylitError
from processing.errors import ParameterError
from processing.ground.arrays import Flags, Floats
from processing.ground.finished import RESULT_NAME
from processing.ground.seam import resized
from processing.ground.threads import limit_libraries
from processing.layout.arrangement import PlacedItem
from processing.pictures.images import LuminanceImage
from processing.pictures.preview import read_mask
from processing.pipeline import resolve, stage_named
from processing.removal.fill import Quick
from processing.running.artifacts import file_name, load
from processing.running.choices import go_on_with, going_on
from processing.running.fingerprint import visible_part
from processing.running.requests import RunRequest, given_answers, given_files, parameters
from processing.running.results import parse_result
from processing.running.screens import SCREEN_PX, look_of, shown_jpeg
from processing.stages.contract import Quality, StageContext
from processing.stages.detect import LAYERS, drawn_over
from processing.stages.materials import emptied as sunlit_anew
from processing.stages.remove import emptied
from processing.stages.upright import draft_width_px, in_size, mask_in_size, upright_panorama
from station.session import strict_json
from station.session.store import load_manifest

# What a changed mask would give, before it is run: the emptied room in seconds, by the stage's own filling.
#
# The picture has the size of a draft (`draft_width_px`); what was hidden is filled at half of that and enlarged, what
# is seen stays as sharp as it is. The shade of the old furniture is lifted as the last run found it. Nothing is written
# to the session.

LEAST_WORK_PX = 640  # width below which the filling is not worked at half size (chosen: a door is then 20 pixels wide)
SHADE_ROWS = 128  # of the shade, which is smooth (chosen: half of what a run has)
KINDS = ("captured", "clear", "overcast")
FURNISHED = ("materials/scene.npz", "remove/empty.exr", "render/staged.json")
"""What a room that furniture stands in depends on."""


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
            raise ParameterError("nothing to preview", where=self._session.name, likely=reason)
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

        None where it left it out."""
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
            elif name == "shade":  # about `SHADE_ROWS` rows of a run's
                with np.load(path) as kept:
                    step = max(1, kept["seen"].shape[0] // SHADE_ROWS)
                    arrays = {name: kept[name][step // 2 :: step, step // 2 :: step] for name in kept.files}
                value = Path(self._place.name) / "shade.npz"
                np.savez(value, **arrays)
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


class Warm:
    """What has been read and made ready for a session; a request's answer is its facts and a file's bytes."""

    def __init__(self, session: Path) -> None:
        self._session, self._previews = session, Previews(session)
        self._rooms: dict[tuple[Any, ...], Any] = {}
        self._furnished: Any = None

    def answer(self, asked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Do what is asked; raises `ParameterError` for what is not known, and what the work raises."""
        verbs = {
            "emptied": self._emptied,
            "room": self._room,
            "staged": self._staged,
            "light": self._light,
            "glare": self._glare,
        }
        verb, begin_s = verbs.get(str(asked.get("do"))), time.perf_counter()
        if verb is None:
            raise ParameterError("no such request", where="preview")
        facts, payload = verb(asked)
        return facts | {"seconds": round(time.perf_counter() - begin_s, 3)}, payload

    def _emptied(self, _asked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        image = self._previews.emptied()
        facts = {"size_px": list(image.rgb.shape[1::-1]), "media": "image/jpeg"}
        return facts, shown_jpeg(image.rgb, look_of(self._session), SCREEN_PX)

    def _room(self, asked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Return the room estimated again around what the one that is sent holds."""
        from processing.ground.room_model import RoomModel, check_room, room_text
        from processing.running.room_anew import room_around

        check_room(asked["room"])
        found = room_around(self._session, RoomModel.model_validate_json(json.dumps(asked["room"])))
        return {"media": "application/json"}, room_text(found).encode()

    def _staged(self, asked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Return the room with furniture where it is asked to stand, lit by the captured light."""
        from processing.relighting.live_furniture import LiveFurniture, style_of

        key = [path.stat().st_mtime_ns for name in FURNISHED if (path := self._session / "stages" / name).is_file()]
        if self._furnished is None or self._furnished[0] != key:
            live = LiveFurniture(self._session, self._previews.sunless())
            self._furnished = key, live, look_of(self._session)
        _, live, look = self._furnished
        items = [PlacedItem.model_validate_json(json.dumps(item)) for item in asked["items"]]
        chosen = go_on_with(self._session, dict.fromkeys(("style", "furniture")))
        image = live.staged(items, chosen["style"] or style_of(self._session), chosen["furniture"])
        return {"media": "image/jpeg"}, shown_jpeg(image.rgb, look, SCREEN_PX)

    def _lit(self, asked: dict[str, Any]) -> tuple[Any, Any]:
        """Return the room that is asked for, as it is on disk, and how it is lit then; no time: as it was captured."""
        from processing.relighting.live import LiveRoom

        staged, kind = asked.get("staged"), asked.get("weather")
        if kind not in KINDS:
            raise ParameterError(f"no such weather: {str(kind)[:20]}", advice=f"one of {', '.join(KINDS)}")
        chosen = go_on_with(self._session, dict.fromkeys(("site", "heading", "zone", "furniture")))
        names = ("materials/scene.npz", "remove/empty.exr", f"render/staged-{staged}.exr")
        files = [path for name in names if (path := self._session / "stages" / name).is_file()]
        key = (staged, *chosen.items(), *(path.stat().st_mtime_ns for path in files))
        if key not in self._rooms:
            self._rooms = {key: LiveRoom(self._session, staged, chosen)}
        room = self._rooms[key]
        return room, room.under(str(asked.get("at") or f"{room.captured:%Y-%m-%d %H:%M}"), kind)

    def _light(self, asked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        room, relit = self._lit(asked)
        facts = {"captured": f"{room.captured:%Y-%m-%d %H:%M}", "media": "application/json", **relit.facts}
        return facts, room.page(relit, exposed=bool(asked.get("exposed", True))).encode()

    def _glare(self, asked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        seat = asked.get("seat_m") and (float(asked["seat_m"][0]), float(asked["seat_m"][1]))
        return self._lit(asked)[0].glare(seat, float(asked["azimuth_deg"])), b""


def main() -> int:
    """Answer requests until the input ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    limit_libraries()
    held: dict[str, Warm] = {}
    for line in sys.stdin:
        try:
            asked = strict_json.loads(line.encode())
            if asked["session"] not in held:
                held.clear()
                gc.collect()  # what was held goes before more is read
                held[asked["session"]] = Warm(Path(sys.argv[1], asked["session"]))
            facts, payload = held[asked["session"]].answer(asked)
        except Exception as error:  # noqa: BLE001 (a preview that fails must not end the program)
            unknown = {"code": "PRC-000", "message": repr(error)[:300]}
            facts, payload = {"error": error.to_dict() if isinstance(error, DaylitError) else unknown}, b""
        try:
            out.write(json.dumps({**facts, "bytes": len(payload)}).encode() + b"\n" + payload)
            out.flush()
        except BrokenPipeError:
            os._exit(0)  # whoever asked was killed; nothing of this program's is left to write
    return 0


if __name__ == "__main__":
    sys.exit(main())
