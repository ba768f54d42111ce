"""What a stage reads of earlier ones, noted as it reads it: a later run looks whether just that has changed.

A read is named like a path: ``calibrate/indoor`` (a file, by its digest), ``calibrate/calibration/outdoor/sun/found``
(one value of a JSON artifact), ``detect/result/metrics/margin_deg`` (of the summary). A stage that reads the same
values does the same work, so what it did not read cannot matter (traces of Mokhov, Mitchell, Peyton Jones, "Build
systems à la carte", 2018, section 4.2).
"""

import copy
import errno
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic_core import to_jsonable_python

from processing.ground.finished import digest
from processing.running.fingerprint import Ingredients, Json
from processing.running.results import FileRecord, PartRecord, StageResult
from processing.stages.parameters import StageParameters
from station.session import strict_json

SUMMARY = "result"
ABSENT = "(absent)"
_ANY = "()"  # as the last part of a name: whether there is anything
_LONGEST = 60  # characters of a text that is kept as it is (chosen); longer ones, lists, objects count by digest
Note = Callable[[str], None]


def read_name(*parts: str) -> str:
    """Return the name of a read; parts with a slash are escaped as in RFC 6901."""
    return "/".join(part.replace("~", "~0").replace("/", "~1") for part in parts)


class Earlier:
    """Results of the stages before, and what a read of them gives now."""

    def __init__(self, folder: Callable[[str], Path]) -> None:
        """``folder(stage)``: where a stage's result is."""
        self.results: dict[str, StageResult] = {}
        self._whole: dict[str, Future[StageResult] | None] = {}
        self._folder = folder
        self._json: dict[tuple[str, str], Json] = {}

    def put(self, result: StageResult, whole: Future[StageResult] | None = None) -> None:
        """Take the result of a stage as it stands now; ``whole``: the same when its files are written."""
        self.results[result.stage] = result
        self._whole[result.stage] = whole
        self._json = {key: value for key, value in self._json.items() if key[0] != result.stage}

    def written(self, stage: str) -> StageResult | None:
        """Return the result of a stage, its files in their place, for which this waits; raises what writing raised."""
        if whole := self._whole.pop(stage, None):
            self.results[stage] = whole.result()
        return self.results.get(stage)

    def value(self, name: str) -> Json:
        """Return what a read gives: a file's digest, a short value, or the digest of a longer one."""
        stage, part, *path = (one.replace("~1", "/").replace("~0", "~") for one in name.split("/"))
        result = self.results.get(stage) if part == SUMMARY else self.written(stage)
        if result is None:
            return ABSENT
        if part == SUMMARY:
            return _leaf(_at(result.summary(), path))
        record = result.files.get(result.artifacts.get(part, ""))
        if record is None:
            return None
        return _leaf(_at(self._read(stage, part), path)) if path else record.sha256

    def _read(self, stage: str, artifact: str) -> Json:
        key = (stage, artifact)
        if key not in self._json:
            path = self._folder(stage) / self.results[stage].artifacts[artifact]
            self._json[key] = strict_json.loads(path.read_bytes())
        return self._json[key]


def _at(value: Json, path: list[str]) -> Json:
    for key in path:
        if key == _ANY:
            return bool(value)
        if not isinstance(value, Mapping) or key not in value:
            return ABSENT
        value = value[key]
    return value


def _leaf(value: Json) -> Json:
    if value is None or isinstance(value, bool | int | float) or (isinstance(value, str) and len(value) <= _LONGEST):
        return value
    return digest(value)


class Noted(Mapping[str, Any]):
    """A JSON object that notes which of its values are read; not a dict, so that no reading goes unnoticed."""

    def __init__(self, value: Mapping[str, Any], name: str, note: Note) -> None:
        self._value, self._name, self._note = value, name, note

    def __getitem__(self, key: str) -> Any:
        name = f"{self._name}/{read_name(key)}"
        if key not in self._value:
            self._note(name)
            raise KeyError(key)
        value = self._value[key]
        if isinstance(value, dict):
            return Noted(value, name, self._note)
        self._note(name)
        return copy.deepcopy(value)

    def __iter__(self) -> Iterator[str]:
        self._note(self._name)
        return iter(self._value)

    def __len__(self) -> int:
        self._note(self._name)
        return len(self._value)

    def __bool__(self) -> bool:
        self._note(f"{self._name}/{_ANY}")
        return bool(self._value)

    def __eq__(self, other: object) -> bool:
        return self.plain() == (other.plain() if isinstance(other, Noted) else other)

    def __repr__(self) -> str:
        return repr(self.plain())

    def plain(self) -> dict[str, Any]:
        """Return all of it as a dict."""
        self._note(self._name)
        return copy.deepcopy(dict(self._value))


class Reads:
    """The reads of one stage while it works."""

    def __init__(self, earlier: Earlier, parameters: StageParameters) -> None:
        self._earlier, self._parameters = earlier, parameters
        self._names: dict[str, None] = {}
        self.parameters: dict[str, Json] = {}

    @property
    def found(self) -> dict[str, Json]:
        """What the reads so far give; this waits for files that are still being written."""
        return {name: self._earlier.value(name) for name in self._names}

    def note_parameter(self, name: str) -> None:
        """Note that the stage looked at one of its parameters."""
        self.parameters[name] = to_jsonable_python(getattr(self._parameters, name))

    def ingredients(self) -> Ingredients:
        """Return what was read, as part of what a result depends on."""
        reads = dict(sorted(self.found.items()))
        for name in self._names:  # where all around a value was read too, that counts for it
            parts = name.split("/")
            if any("/".join(parts[:count]) in self._names for count in range(2, len(parts))):
                del reads[name]
        return {"parameters": dict(sorted(self.parameters.items())), "reads": reads}

    def again(self, ingredients: Ingredients) -> Ingredients:
        """Return what earlier reads give now."""
        for name in ingredients.get("parameters", {}):
            if hasattr(self._parameters, name):
                self.note_parameter(name)
        for name in ingredients.get("reads", {}):
            self.note(name)
        return self.ingredients()

    def note(self, name: str) -> None:
        """Note a read."""
        self._names[name] = None

    def now(self, name: str) -> Json:
        """Return what a read gives."""
        return self._earlier.value(name)

    def noted(self, value: object, *parts: str) -> Any:
        """Return what is read: a JSON object that notes what is taken of it, everything else as it is, noted."""
        name = read_name(*parts)
        if isinstance(value, dict):
            return Noted(value, name, self.note)
        self.note(name)
        return value


# Parts of a stage's result that stand or fall each by itself: one alternative is rendered, the others are kept.

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
            try:
                os.link(self.old / former, self.new / name)
            except OSError as error:  # a copy of its own where the file system knows no second names
                if error.errno not in _NO_LINKS:
                    raise
                shutil.copyfile(self.old / former, self.new / name)
            self.kept[name] = self.former.files[former]


def unread(options: Mapping[str, str], result: StageResult) -> str:
    """Return which flags (of ``options``: flag, parameter) a stage was given and did not look at, as words."""
    seen: Any = result.ingredients.get("parameters", {})
    flags = [flag for flag, name in options.items() if name not in seen]
    return f"; not needed here: {', '.join(flags)}" if flags else ""
