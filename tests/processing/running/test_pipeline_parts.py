"""What a stage read is what it depends on; parts of a result stand each by itself; the first part goes first; pictures
are written while the next stage works with them."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from pydantic import Field

from processing.errors import ParameterError
from processing.ground.finished import Finished
from processing.ground.threads import ASKED
from processing.pictures import exr
from processing.pipeline import Artifact, Stage
from processing.running.requests import RunRequest
from processing.running.results import Action, RunEvent, RunEventKind
from processing.running.runner import clean, process
from processing.stages.contract import StageContext, StageOutput
from processing.stages.parameters import StageParameters
from station.errors import DiskFullError
from tests.processing.pictures.picture_strategies import luminance_image
from tests.processing.running import toy_stages
from tests.processing.running.test_pipeline import actions, contents, reason, result, run
from tests.processing.running.toy_stages import FRAMES, TOTAL, TOYS
from tests.station.session.sessions import complete_session

RAN, SKIPPED = Action.RAN, Action.SKIPPED
PARTS = "tests.processing.running.test_pipeline_parts"


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_STATE", str(tmp_path / "state"))
    toy_stages.calls.clear()


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return complete_session(tmp_path / "sessions")


class Scaled(StageParameters):
    scale: Annotated[float, Field(description="Scale")] = 1.0


class Colours(StageParameters):
    colours: Annotated[str, Field(description="Letters")] = "rg"


def painted(context: StageContext) -> StageOutput:
    """A stage of parts: one file a colour, which also depends on what the stage before gave."""
    total = context.artifact("total", "total").total
    made, asked = {}, context.parameters_of(Colours).colours
    for number, colour in enumerate(asked):

        def make(colour: str = colour, number: int = number) -> dict[str, object]:
            toy_stages.calls.append(colour)
            (context.folder / f"{number}.txt").write_text(f"{colour} {total}")
            return {"colour": colour}

        made[f"c{number}"] = context.part(f"c{number}", (f"{number}.txt",), colour, make)["colour"]
        if context.enough() and number + 1 < len(asked):
            break
    missing = {f"c{k}": "no such colour" for k in range(len(made), 3)}
    return StageOutput(artifacts=dict.fromkeys(made, True), left_out=missing, unfinished=len(made) < len(asked))


def seen(context: StageContext) -> StageOutput:
    there = [path.read_text() for k in range(3) if (path := context.optional_artifact("paint", f"c{k}"))]
    toy_stages.calls.append("seen " + " ".join(there))
    return StageOutput(metrics={"seen": there})


PAINT = Stage(
    name="paint",
    version=1,
    title="colours",
    function=f"{PARTS}:painted",
    needs=("total",),
    makes=tuple(Artifact(f"c{k}", "file", optional=True, file_name=f"{k}.txt") for k in range(3)),
    parameters=f"{PARTS}:Colours",
)
SHOW = Stage(
    name="show",
    version=1,
    title="what is there",
    function=f"{PARTS}:seen",
    needs=("paint",),
)
PAINTED = (FRAMES, TOTAL, PAINT, SHOW)


@pytest.fixture
def one(tmp_path: Path) -> Path:
    path = tmp_path / "total.json"
    path.write_text('{"total": 1}')
    return path


def test_parts_of_a_result_are_kept_one_by_one(session: Path, one: Path, tmp_path: Path) -> None:
    run(session, PAINTED, options={"--total": one})
    assert toy_stages.calls == ["frames", "r", "g", "seen r 1.0 g 1.0"]
    asked = {"--total": one, "--colours": "bgr"}
    assert actions(run(session, PAINTED, options=asked))[2:] == [RAN, RAN]
    assert toy_stages.calls == ["b", "seen b 1.0 g 1.0 r 1.0"], "the others are the same files under other names"
    assert actions(run(session, PAINTED, options=asked, recheck=True)) == [SKIPPED] * 4
    alone = tmp_path / "alone"
    shutil.copytree(session, alone, ignore=shutil.ignore_patterns("stages"))
    run(alone, PAINTED, options=asked)
    assert contents(alone) == contents(session), "whatever was kept"
    run(session, PAINTED, options=asked, force=("paint",))
    assert toy_stages.calls == ["b", "g", "r"]
    one.write_text('{"total": 2}')
    run(session, PAINTED, options={**asked, "--colours": "bg"})
    assert toy_stages.calls == ["b", "g", "seen b 2.0 g 2.0"], "they read the total"


def test_the_first_part_goes_through_before_the_rest(session: Path, one: Path) -> None:
    events: list[RunEvent] = []
    request = RunRequest(options={"--total": one, "--colours": "rgb"}, first_picture=True)
    report = process(session, request, stages=PAINTED, on_event=events.append)
    assert toy_stages.calls == ["frames", "r", "seen r 1.0", "g", "b", "seen r 1.0 g 1.0 b 1.0"]
    assert [stage.stage for stage in report.stages] == ["frames", "total", "paint", "show"]
    assert [e.stage for e in events if e.kind is RunEventKind.FIRST] == ["paint"]
    before = contents(session)
    assert actions(process(session, request, stages=PAINTED)) == [SKIPPED] * 4
    run(session, PAINTED, options=dict(request.options), force=("paint", "show"))
    assert contents(session) == before, "in one go or in two"


def test_a_stage_depends_on_the_values_it_read(session: Path) -> None:
    """Not on all of what an earlier stage wrote, and not on parameters that it did not look at."""
    curious = replace(TOTAL, function=f"{PARTS}:look", makes=(), parameters=f"{PARTS}:Scaled")
    look.name = json.loads((session / "session.json").read_text())["frames"][0]["file"]  # type: ignore[attr-defined]
    run(session, (FRAMES, curious))
    reads = result(session, "total")["ingredients"]["reads"]
    value = "frames/values/" + look.name.replace("/", "~1")  # type: ignore[attr-defined]
    assert set(reads) == {value, "frames/values/()", "frames/result/metrics/frames"}
    report = run(session, (FRAMES, curious), options={"--scale": 3.0})
    assert actions(report) == [SKIPPED, SKIPPED]
    assert "not needed here: --scale" in reason(report, "total")
    assert actions(run(session, (FRAMES, curious), options={"--rounds": 5})) == [RAN, RAN]


def look(context: StageContext) -> StageOutput:
    values = context.optional_artifact("frames", "values")
    assert values
    assert values[look.name] >= 0  # type: ignore[attr-defined]
    assert "frames" in context.summary("frames")["metrics"]
    return StageOutput()


def test_what_only_stages_need_can_be_dropped(session: Path) -> None:
    run(session, TOYS)
    before, before_metrics = contents(session), result(session, "frames")["metrics"]
    (session / "stages" / ".old-half").mkdir()
    freed = clean(session, ("total",), stages=TOYS)
    assert set(freed) == {"frames", "half"}
    assert freed["frames"] >= sum(len(data) for name, data in before.items() if name.startswith("frames/"))
    assert sorted(path.name for path in (session / "stages").iterdir() if path.is_dir()) == ["total"]
    assert Finished(session, "frames").facts["metrics"] == before_metrics, "what it found is still known"
    assert actions(run(session, TOYS)) == [RAN, SKIPPED, RAN], "what depends on it gives the same and stands"
    assert not list((session / "stages").glob(".cleaned-*")), "and does not outlive what is made anew"
    assert contents(session) == before
    with pytest.raises(ParameterError, match="no such stage: 'roof'"):
        clean(session, ("roof",), stages=TOYS)


def test_a_value_read_before_all_around_it_is_no_change(session: Path) -> None:
    both = replace(TOTAL, function=f"{PARTS}:twice", makes=(), parameters=f"{PARTS}:Scaled")
    run(session, (FRAMES, both))
    assert set(result(session, "total")["ingredients"]["reads"]) == {"frames/values"}
    assert actions(run(session, (FRAMES, both))) == [SKIPPED, SKIPPED]


def twice(context: StageContext) -> StageOutput:
    values = context.optional_artifact("frames", "values") or {}
    assert sum(values.values()) >= 0
    return StageOutput()


# A picture is written while the next stage works with the one in memory.

began = threading.Event()
"""The stage after the picture works."""
write_picture = exr._write


def viewed(context: StageContext) -> StageOutput:
    values = context.artifact("frames", "values")
    toy_stages.calls.append("view")
    return StageOutput(artifacts={"view": luminance_image(np.full((4, 8, 3), 1.0 + len(values), np.float32))})


def measured(context: StageContext) -> StageOutput:
    mean = float(context.artifact("view", "view").rgb.mean())
    began.set()
    toy_stages.calls.append("mean")
    return StageOutput(artifacts={"mean": {"mean": mean}})


VIEW = Stage(
    name="view",
    version=1,
    title="a picture",
    function=f"{PARTS}:viewed",
    needs=("frames",),
    makes=(Artifact("view", "picture"),),
)
MEAN = Stage(
    name="mean",
    version=1,
    title="its mean",
    function=f"{PARTS}:measured",
    needs=("view",),
    makes=(Artifact("mean", "json"),),
)
VIEWED = (FRAMES, VIEW, MEAN)


def slowly(*given: Any) -> None:
    assert began.wait(30), "the next stage waits for the picture's file"
    write_picture(*given)


def full(*_: Any) -> None:
    assert began.wait(30)
    raise OSError(errno.ENOSPC, "No space left on device")


def dies(*_: Any) -> None:
    began.wait(30)
    os._exit(9)


def killed(session: str) -> None:
    """Process a session and die while the picture is written and the next stage works."""
    exr._write = dies
    process(Path(session), RunRequest(), stages=VIEWED)


def test_a_picture_is_written_while_the_next_stage_works(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exr, "_write", slowly)
    monkeypatch.setenv(ASKED, "2")
    began.clear()
    assert actions(run(session, VIEWED)) == [RAN] * 3
    before = contents(session)
    assert (
        result(session, "mean")["ingredients"]["reads"]["view/view"]
        == result(session, "view")["files"]["view.exr"]["sha256"]
    )  # type: ignore[index]
    assert actions(run(session, VIEWED)) == [SKIPPED] * 3
    monkeypatch.setenv(ASKED, "1")
    assert actions(run(session, VIEWED, force=("frames", "view", "mean"))) == [RAN] * 3
    assert contents(session) == before, "at once or behind"
    monkeypatch.setenv(ASKED, "2")
    began.clear()
    began.set()
    assert actions(run(session, VIEWED, force=("view",))) == [SKIPPED, RAN, SKIPPED], (
        "it is compared when it is written"
    )


def test_a_picture_that_cannot_be_written_is_its_own_stage_s_failure(
    session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[RunEvent] = []
    monkeypatch.setenv(ASKED, "2")
    began.clear()
    with monkeypatch.context() as patch:
        patch.setattr(exr, "_write", full)
        with pytest.raises(DiskFullError, match="writing"):
            process(session, RunRequest(), stages=VIEWED, on_event=events.append)
    assert (events[-1].kind, events[-1].stage) == (RunEventKind.FAILED, "view")
    assert [path.name for path in (session / "stages").iterdir() if path.is_dir()] == ["frames"], "nor what came after"
    assert actions(run(session, VIEWED)) == [SKIPPED, RAN, RAN]


def test_killed_between_a_stage_and_its_picture_all_before_it_stands(session: Path) -> None:
    command = [sys.executable, "-c", f"from {PARTS} import killed; killed({str(session)!r})"]
    root = Path(__file__).resolve().parents[3]
    died = subprocess.run(command, cwd=root, env={**os.environ, ASKED: "2"}, timeout=120, check=False)
    assert died.returncode == 9
    there = {path.name for path in (session / "stages").iterdir() if not path.name.startswith(".")}
    assert there == {"frames"}, "the next stage was done, and is not put in its place before the picture"
    assert actions(run(session, VIEWED)) == [SKIPPED, RAN, RAN]
    assert not [path for path in (session / "stages").iterdir() if path.name.startswith(".part-")]
