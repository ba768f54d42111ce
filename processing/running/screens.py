"""What screens show of a session's pictures: JPEG small enough to travel, numbers for the viewer, frames."""

import io
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

from processing.errors import ParameterError
from station.session.store import load_manifest

STATES = {
    "Photograph": ("stages/room/panorama.exr", "stages/calibrate/indoor.exr", "stages/merge/indoor.exr"),
    "Emptied": ("stages/remove/empty.exr",),
    **{f"Staged {k}": (f"stages/render/staged-{k}.exr",) for k in range(1, 8)},
}
"""Pictures of the room, and where each may lie."""
SHOWN_BY = ("room/room.json", "stills/display.json", "materials/sun.npz")  # besides the picture and the photograph
CARD = "stages/stills/still-1.jpg"
"""What shows a session at a glance where there is one; else the middle frame of the room does, or its photograph."""
SCREEN_PX, LARGEST_PX = 2048, 4096
"""Width of a panorama on a screen, and of the picture that smaller ones are made of (chosen)."""
JPEG_QUALITY = 88  # chosen: artifacts are not seen at twice the size


def picture_of(session: Path, state: str) -> Path | None:
    """Return the file of a state; None where there is none yet."""
    return next((p for name in STATES.get(state, ()) if (p := session / name).is_file()), None)


def _there(session: Path, state: str) -> Path:
    if (path := picture_of(session, state)) is None:
        raise ParameterError("no such picture yet", where=f"{session.name}: {state[:40]}")
    return path


def look_of(session: Path) -> Any:
    """Return how a session's pictures are shown: in its own display, its windows as a screen resolves them."""
    from processing.exchange.showing import panes_of, session_shown
    from processing.report.states import Look
    from processing.sphere import Equirectangular

    found = session_shown(session)
    return Look(found.display, panes_of(found.room, Equirectangular(SCREEN_PX, SCREEN_PX // 2), found.display.views))


def picture_jpeg(session: Path, state: str, width_px: int) -> bytes:
    """Return a panorama of the room as JPEG, at most ``width_px`` wide; "Card": see `CARD`."""
    if state == "Card":
        manifest = load_manifest(session)
        frames = [one.file for one in manifest.frames if one.side == "indoor" and not one.is_raw]
        given = [] if manifest.panorama is None else [manifest.panorama.file]
        found = [p for name in (CARD, *frames[len(frames) // 2 :][:1], *given) if (p := session / name).is_file()]
        return small_jpeg(found[0], width_px) if found else picture_jpeg(session, "Photograph", width_px)
    path = _there(session, state)
    of = (path, picture_of(session, "Photograph") or path, *(session / "stages" / name for name in SHOWN_BY))
    whole = _jpeg(path, session, tuple(one.stat().st_mtime_ns if one.is_file() else 0 for one in of))
    return whole if width_px >= LARGEST_PX else small_jpeg(io.BytesIO(whole), width_px)


@lru_cache(maxsize=24)
def _jpeg(path: Path, session: Path, _at: tuple[int, ...]) -> bytes:
    from processing.pictures.patch import read_shown

    return shown_jpeg(read_shown(path).rgb, look_of(session), LARGEST_PX)


def shown_jpeg(rgb: Any, look: Any, width_px: int) -> bytes:
    """Return linear light (H, W, 3) of a panorama as JPEG, at most ``width_px`` wide, as ``look`` shows it."""
    import cv2

    from processing.report.states import shown

    height, width = rgb.shape[:2]
    wide = min(width_px, width)
    small: Any = cv2.resize(rgb, (wide, wide * height // width), interpolation=cv2.INTER_AREA)
    coded, data = cv2.imencode(".jpg", shown(small, look)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert coded
    return bytes(data.tobytes())


def viewer_json(session: Path, state: str) -> str:
    """Return what the viewer with exposure and probe shows of a state, as the report's page holds it."""
    from processing.exchange.showing import made_of
    from processing.pictures.patch import read_shown
    from processing.report.states import State, viewer

    path = _there(session, state)
    image: Any = read_shown(path)
    name = path.relative_to(session).as_posix()
    return viewer(State(state, lambda: image, made_of(session, state), name), look_of(session)).json


def frame_jpeg(session: Path, file: str, width_px: int) -> bytes:
    """Return a frame as it came from the camera, small."""
    if file not in {frame.file for frame in load_manifest(session).frames if not frame.is_raw}:
        raise ParameterError("no such frame", where=file[:80])
    return small_jpeg(session / file, width_px)


def small_jpeg(file: Path | BinaryIO, width_px: int) -> bytes:
    """Return a JPEG file's picture at most ``width_px`` wide and high."""
    from PIL import Image

    with Image.open(file) as frame:
        frame.draft("RGB", (width_px, width_px))
        frame.thumbnail((width_px, width_px))
        out = io.BytesIO()
        frame.convert("RGB").save(out, "JPEG", quality=JPEG_QUALITY)
    return out.getvalue()
