"""What the stages of a processed session made, for those who read it later: each file as its stage recorded it."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from processing.errors import ResultFileError
from station.session import strict_json
from station.session.folder import file_sha256

RESULT_NAME = "result.json"
CLEANED = ".cleaned-{}.json"
"""In stages/: the result.json of a stage whose files were cleaned away, by which others still know what it found."""
PLAIN_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"


def digest(value: Any) -> str:
    """Return the SHA-256 of a JSON value, hexadecimal; it is written one way only: sorted keys, shortest numbers."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


class Finished:
    """A stage's result. Raises `ResultFileError` for what is missing, cannot be read, or was changed."""

    def __init__(self, session: Path, stage: str) -> None:
        self._session, self._folder = session, session / "stages" / stage
        own, cleaned = self._folder / RESULT_NAME, session / "stages" / CLEANED.format(stage)
        facts = self._read(cleaned if cleaned.is_file() and not own.is_file() else own)
        if not isinstance(facts, dict) or facts.pop("seal", "") != digest(facts) or facts.get("stage") != stage:
            raise self._refused(RESULT_NAME, "has changed since it was written")
        self.facts: dict[str, Any] = facts  # of result.json: metrics, skipped, given ...

    def _read(self, path: Path) -> Any:
        try:
            return strict_json.loads(path.read_bytes())
        except FileNotFoundError as error:
            raise self._refused(path.name, "is not there: has the stage run?") from error
        except (OSError, strict_json.StrictJsonError) as error:
            raise self._refused(path.name, f"cannot be read: {getattr(error, 'strerror', None) or error}") from error

    def _refused(self, name: str, what: str) -> ResultFileError:
        advice = f"daylit process {self._session} rebuilds it; if not, add --force {self._folder.name}"
        return ResultFileError(f"{name[:100]} {what}", where=str(self._folder), advice=advice)

    def __contains__(self, name: str) -> bool:
        """Return whether the stage made a file of this name."""
        return name in self.facts["files"]

    def path(self, name: str) -> Path:
        """Return a file that the stage made, as it made it."""
        path, plain = self._folder / name, re.fullmatch(PLAIN_NAME, name)
        if not path.is_file():
            raise self._refused(name, "is missing")
        if name not in self or not plain or file_sha256(path) != self.facts["files"][name]["sha256"]:
            raise self._refused(name, "has changed since its stage wrote it")
        return path

    def json(self, name: str) -> Any:
        """Return the value in a JSON file that the stage made."""
        return self._read(self.path(name))
