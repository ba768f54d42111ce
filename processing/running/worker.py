"""A warm program for one session: ``python -m processing.running.worker SESSION`` keeps its pictures and light at hand.

A request is a line of JSON on standard input ({"do": name, ...}), an answer a line of JSON and as many bytes as its
"bytes" says. It ends with its input. Nothing is written to the session but the basis of its light.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from drivers.errors import DaylitError
from processing.errors import ParameterError
from processing.ground.threads import limit_libraries
from processing.layout.arrangement import PlacedItem
from processing.running.choices import go_on_with
from processing.running.preview import Previews
from processing.running.screens import look_of, shown_jpeg
from station.session import strict_json

WIDTH_PX = 2048  # of a preview (chosen: a screen's)
KINDS = ("captured", "clear", "overcast")
FURNISHED = ("materials/scene.npz", "remove/empty.exr", "render/staged.json")
"""What a room that furniture stands in depends on."""


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
        return facts, shown_jpeg(image.rgb, look_of(self._session, image), WIDTH_PX)

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
            self._furnished = key, live, look_of(self._session, live.photograph)
        _, live, look = self._furnished
        items = [PlacedItem.model_validate_json(json.dumps(item)) for item in asked["items"]]
        chosen = go_on_with(self._session, dict.fromkeys(("style", "furniture")))
        image = live.staged(items, chosen["style"] or style_of(self._session), chosen["furniture"])
        return {"media": "image/jpeg"}, shown_jpeg(image.rgb, look, WIDTH_PX)

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
    warm = Warm(Path(sys.argv[1]))
    for line in sys.stdin:
        try:
            facts, payload = warm.answer(strict_json.loads(line.encode()))
        except DaylitError as error:
            facts, payload = {"error": error.to_dict()}, b""
        except Exception as error:  # noqa: BLE001 (a preview that fails must not end the program)
            facts, payload = {"error": {"code": "PRC-000", "message": repr(error)[:300]}}, b""
        out.write(json.dumps({**facts, "bytes": len(payload)}).encode() + b"\n" + payload)
        out.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
