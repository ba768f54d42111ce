"""Sessions whose stages did not run, with results that look as if they had."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from processing.ground.finished import RESULT_NAME, digest
from processing.running.results import FileRecord, StageResult, result_bytes
from station.session.folder import file_sha256


def finish(session: Path, stage: str, *, ingredients: dict[str, Any] | None = None, **fields: Any) -> Path:
    """Write the result.json of a stage for the files that lie in its folder, and return the folder."""
    folder = session / "stages" / stage
    folder.mkdir(parents=True, exist_ok=True)
    paths = [path for path in sorted(folder.iterdir()) if path.name != RESULT_NAME]
    files = {path.name: FileRecord(size_bytes=path.stat().st_size, sha256=file_sha256(path)) for path in paths}
    known = {"fingerprint": digest({}), "ingredients": ingredients or {}, "files": files}
    result = StageResult(stage=stage, version=1, **known, **fields)
    (folder / RESULT_NAME).write_bytes(result_bytes(result.sealed()))
    return folder


def finish_all(session: Path, **metrics: dict[str, Any]) -> None:
    """Finish all stages that results are read of; ``metrics`` by stage."""
    for stage in ("merge", "calibrate", "room", "detect", "remove", "materials", "arrange", "render", "stills"):
        finish(session, stage, metrics=metrics.get(stage, {}))
