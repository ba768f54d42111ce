"""Parts of a stage's result that stand or fall each by itself: one alternative is rendered, the others are kept."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from processing.running.fingerprint import Ingredients, Json, digest
from processing.running.reads import Reads
from processing.running.results import FileRecord, PartRecord, StageResult

_NO_LINKS = {errno.EPERM, errno.EXDEV, errno.EOPNOTSUPP, errno.EMLINK}


@dataclass
class Parts:
    """The parts of the result that is being built, beside those of the one before it."""

    former: StageResult | None
    """None: nothing is to be kept."""
    old: Path
    new: Path
    common: Ingredients
    """What all parts depend on: the stage's version, files given."""
    reads: Reads
    first_only: bool = False
    records: dict[str, PartRecord] = field(default_factory=dict)
    kept: dict[str, FileRecord] = field(default_factory=dict)
    """Files taken over, under their new names."""
    made: int = 0

    def part(self, name: str, files: tuple[str, ...], own: Json, make: Callable[[], Any], apart: str = "") -> Any:
        """Return the facts of a part: of the former result where it was made of the same, else as ``make`` gives them.

        ``own``: what it depends on by itself; what the stage has read so far counts too, but of the stage ``apart``.
        """
        own_digest = digest({"own": own, **self.common})
        for record in (self.former.parts if self.former else {}).values():
            if record.own == own_digest and all(self._same(*read) for read in record.reads.items()):
                self._take(record, files)
                self.records[name] = record.model_copy(update={"files": files})
                return record.facts
        facts = make()
        read = {key: value for key, value in sorted(self.reads.found.items()) if key.partition("/")[0] != apart}
        self.records[name] = PartRecord(own=own_digest, reads=read, files=files, facts=facts)
        self.made += 1
        return facts

    def enough(self) -> bool:
        """Return whether what there is shall be shown before the rest is made."""
        return self.first_only and self.made > 0

    def _same(self, name: str, value: Json) -> bool:
        self.reads.note(name)
        return bool(self.reads.now(name) == value)

    def _take(self, record: PartRecord, files: tuple[str, ...]) -> None:
        assert self.former is not None
        for name, former in zip(files, record.files, strict=True):
            _linked(self.old / former, self.new / name)
            self.kept[name] = self.former.files[former]


def _linked(old: Path, new: Path) -> None:
    """Give a file a second name; a copy of its own where the file system has no such thing."""
    try:
        os.link(old, new)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        shutil.copyfile(old, new)


def unread(options: Mapping[str, str], result: StageResult) -> str:
    """Return which flags (of ``options``: flag, parameter) a stage was given and did not look at, as words."""
    seen: Any = result.ingredients.get("parameters", {})
    flags = [flag for flag, name in options.items() if name not in seen]
    return f"; not needed here: {', '.join(flags)}" if flags else ""
