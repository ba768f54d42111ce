"""The spine with toy stages: what runs, what is skipped and why."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import pytest

from processing.errors import ParameterError, ProcessingError
from processing.ground.finished import digest
from processing.pipeline import STAGES, Artifact, Stage, check_table, options, resolve, selected, stage_named
from processing.running.fingerprint import changes
from processing.running.requests import RunRequest, decide, planned
from processing.running.result_store import Stored
from processing.running.results import Action, RunEvent, RunEventKind, RunReport, StageResult
from processing.running.runner import process
from processing.stages.contract import Quality, StageContext, StageOutput
from processing.stages.parameters import StageParameters, path_field
from station.session.session import SessionManifest
from tests.processing.running import toy_stages
from tests.processing.running.toy_stages import BROKEN_LAST, FRAMES, HALF, TOTAL, TOYS, contents
from tests.station.session.sessions import complete_session

RAN, SKIPPED, GIVEN, NOTHING = Action.RAN, Action.SKIPPED, Action.GIVEN, Action.NOTHING_TO_DO


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_STATE", str(tmp_path / "state"))
    toy_stages.calls.clear()


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return complete_session(tmp_path / "sessions")


PROCESSING = Path(__file__).resolve().parents[3] / "processing"


def run(session: Path, stages: tuple[Stage, ...] = TOYS, **request: object) -> RunReport:
    toy_stages.calls.clear()
    return process(session, RunRequest(**request), stages=stages)


def actions(report: RunReport) -> list[Action]:
    return [stage.action for stage in report.stages]


def reason(report: RunReport, stage: str) -> str:
    return next(s.reason for s in report.stages if s.stage == stage)


def result(session: Path, stage: str) -> dict[str, object]:
    return json.loads((session / "stages" / stage / "result.json").read_text())


def test_first_run_does_all_and_second_nothing(session: Path) -> None:
    first = run(session)
    assert actions(first) == [RAN, RAN, RAN]
    assert all(s.reason == "no result yet" for s in first.stages)
    assert toy_stages.calls == ["frames", "total", "half"]
    before = contents(session)
    second = run(session)
    assert actions(second) == [SKIPPED] * 3
    assert toy_stages.calls == []
    assert reason(second, "frames") == "no input has changed, 2 files intact"
    assert contents(session) == before
    assert second.stages[0].summary["warnings"] == [{"code": "toy", "message": "a toy"}]


def test_result_says_what_was_made_of_what(session: Path) -> None:
    run(session)
    found = result(session, "total")
    assert found["left_out"] == {"extra": "nobody asked"}
    assert found["artifacts"] == {"total": "total.json"}
    assert found["ingredients"]["reads"].keys() == {"frames/values"}
    assert found["ingredients"]["parameters"] == {"scale": 1.0}
    assert "frames" not in found["ingredients"]["session"], "it does not read them"
    assert (session / "stages" / "frames" / "notes.txt").exists()
    assert str(session.parent) not in json.dumps(found)


def test_a_parameter_runs_only_what_depends_on_it(session: Path) -> None:
    run(session)
    report = run(session, options={"--scale": 2.0})
    assert actions(report) == [SKIPPED, RAN, RAN]
    assert reason(report, "total") == "changed: parameters scale: 1.0 -> 2.0"
    assert report.stages[1].changes == (("parameters scale", 1.0, 2.0),)
    assert reason(report, "half").startswith("changed: reads total/total: ")


def test_a_stage_whose_inputs_came_out_the_same_is_skipped(session: Path) -> None:
    run(session, options={"--grain": 256})
    report = run(session, options={"--grain": 256, "--rounds": 4})
    assert actions(report) == [RAN, SKIPPED, SKIPPED]
    assert toy_stages.calls == ["frames"]


def test_quality_counts_only_where_it_is_traded(session: Path) -> None:
    run(session)
    report = run(session, quality=Quality.DRAFT)
    assert reason(report, "frames") == "changed: trades quality: standard -> draft"
    assert report.stages[0].summary["honoured"] == {"quality": "draft"}
    report = run(session, quality=Quality.DRAFT, max_error=0.02)
    assert actions(report) == [SKIPPED, SKIPPED, RAN]


def test_a_changed_frame_or_fact_is_reported(session: Path) -> None:
    run(session)
    path = session / "session.json"
    data = json.loads(path.read_text())
    data["frames"][0]["camera_s"] = 5.0
    data["site"]["latitude_deg"] = 40.0
    path.write_text(json.dumps(data))
    report = run(session)
    file = data["frames"][0]["file"]
    assert report.stages[0].changes == ((f"session frames {file} camera_s", 4.0, 5.0),), "the site is not read"


def test_a_new_version_of_a_stage_runs_it(session: Path) -> None:
    run(session)
    report = run(session, (replace(FRAMES, version=2), TOTAL, HALF))
    assert actions(report) == [RAN, SKIPPED, SKIPPED]
    assert reason(report, "frames") == "changed: version: 1 -> 2"


def test_force_until_and_dry_run(session: Path) -> None:
    assert actions(run(session, until="total")) == [RAN, RAN]
    assert not (session / "stages" / "half").exists()
    forced = run(session, force=("total",))
    assert actions(forced) == [SKIPPED, RAN, RAN]
    assert reason(forced, "total") == "forced by --force"
    before = contents(session)
    dry = run(session, dry_run=True, options={"--rounds": 9})
    assert actions(dry) == [Action.WOULD_RUN, Action.DEPENDS, Action.DEPENDS]
    assert reason(dry, "half") == "on the new results of total"
    assert actions(run(session, dry_run=True)) == [SKIPPED] * 3
    assert contents(session) == before
    assert toy_stages.calls == []


def test_dry_run_on_a_fresh_session_changes_nothing(session: Path) -> None:
    before = sorted(p.name for p in session.iterdir())
    assert actions(run(session, dry_run=True))[0] is Action.WOULD_RUN
    assert sorted(p.name for p in session.iterdir()) == before


def test_an_answer_takes_the_place_of_a_stage(session: Path, tmp_path: Path) -> None:
    answer = tmp_path / "mine.json"
    answer.write_text('{"total": 100}')
    report = run(session, options={"--total": answer})
    assert actions(report) == [RAN, GIVEN, RAN]
    assert json.loads((session / "stages" / "half" / "half.json").read_text()) == 50.0
    again = run(session, options={"--total": answer})
    assert actions(again) == [SKIPPED] * 3
    assert reason(again, "total").startswith("given by you (total)")
    assert result(session, "total")["given"] == ["total"]
    without = run(session)
    assert actions(without) == [SKIPPED, RAN, RAN]
    assert "answers total" in {path for path, _, _ in without.stages[1].changes}, "no longer given"
    answer.write_text('{"sum": 100}')
    with pytest.raises(ProcessingError, match="not a valid total: total: Field required"):
        run(session, options={"--total": answer})
    answer.write_text('{"total": 1e9}')
    with pytest.raises(ProcessingError, match="more than the frames"):
        run(session, options={"--total": answer})
    answer.write_text('{"total": 1, "total": 2}')
    with pytest.raises(ProcessingError, match="twice"):
        run(session, options={"--total": answer})


def test_a_given_file_counts_by_its_content(session: Path, tmp_path: Path) -> None:
    file = tmp_path / "two.txt"
    file.write_text("2")
    run(session, options={"--factor": file})
    assert actions(run(session, options={"--factor": file.rename(tmp_path / "zwei.txt")})) == [SKIPPED] * 3
    (tmp_path / "zwei.txt").write_text("3")
    assert actions(run(session, options={"--factor": tmp_path / "zwei.txt"})) == [SKIPPED, RAN, RAN]


def test_a_skip_rule_is_a_result_too(session: Path) -> None:
    report = run(session, options={"--scale": 0.0})
    assert actions(report) == [RAN, RAN, NOTHING]
    assert reason(report, "half") == "the total is zero"
    again = run(session, options={"--scale": 0.0})
    assert actions(again) == [SKIPPED] * 3
    assert reason(again, "half") == "nothing to do: the total is zero"
    assert not (session / "stages" / "half" / "half.json").exists()


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"until": "roof"}, "no such stage: 'roof'"),
        ({"force": ("roof",)}, "no such stage: 'roof'"),
        ({"until": "total", "force": ("half",)}, "stops before"),
        ({"options": {"--k9": 1}}, "does not apply to any stage"),
        ({"until": "frames", "options": {"--scale": 1.0}}, "does not apply to any stage"),
        ({"options": {"--scale": "much"}}, "--scale: "),
        ({"options": {"--factor": "none.txt"}}, "no file none.txt"),
        (
            {"options": {"--total": "t.json", "--scale": 2.0, "--factor": "f.txt"}},
            "--scale, --factor: no effect wi",
        ),
        ({"max_error": 2.0}, "out of range"),
        ({"max_error": float("nan")}, "out of range"),
        ({"until": "total", "time_budget_s": 5.0}, "no stage of this run supports it"),
    ],
)
def test_nothing_that_is_asked_may_do_nothing(session: Path, request_: dict[str, object], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        run(session, **request_)
    assert toy_stages.calls == []


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--mask", "--margin"), "--margin: no effect with --mask"),
        (("--mask", "--sunlight"), "--sunlight: no effect with --mask"),
        (("--mask", "--keep-sunlight"), "--keep-sunlight: no effect with --mask"),
        (("--room", "--camera-height"), "--camera-height: no effect with --room"),
        (("--room", "--layout-model"), "--layout-model: no effect with --room"),
        (("--segmenter-contract",), "--segmenter-contract: no effect without --segmenter"),
        (("--segmenter",), "--segmenter FILE and --segmenter-contract belong together"),
        (("--filler-channels",), "--filler-channels: no effect without --filler"),
    ],
)
def test_options_that_would_do_nothing_are_refused(flags: tuple[str, ...], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        planned(RunRequest(options=dict.fromkeys(flags, "1")), STAGES)


def test_what_went_before_a_failure_stands(session: Path) -> None:
    events: list[RunEvent] = []
    with pytest.raises(ProcessingError, match="cannot"):
        process(session, RunRequest(), stages=BROKEN_LAST, on_event=events.append)
    assert events[-1].kind is RunEventKind.FAILED
    assert actions(run(session)) == [SKIPPED, SKIPPED, RAN]
    assert not [p for p in (session / "stages").iterdir() if p.name.startswith(".part-")]


def test_results_do_not_depend_on_where_when_or_how_often(session: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(session, tmp_path / "elsewhere" / "other name")
    run(session)
    run(copy, options={"--scale": 7.0})
    run(copy)
    assert contents(copy) == contents(session)


def test_progress_states_the_time_left_from_the_second_run_on(session: Path) -> None:
    events: list[RunEvent] = []
    process(session, RunRequest(), stages=TOYS, on_event=events.append)
    assert events[0].left_s is None, "nothing is known yet"
    process(session, RunRequest(force=("frames", "total", "half")), stages=TOYS, on_event=events.append)
    started = [e for e in events if e.kind is RunEventKind.STARTED]
    assert started[3].left_s is not None
    assert started[3].left_s > 0
    fractions = [e.fraction for e in events if e.kind is RunEventKind.PROGRESS]
    assert fractions[:3] == pytest.approx([1 / 3, 2 / 3, 1])


def test_a_stage_sees_only_what_its_row_names(session: Path) -> None:
    seen: list[SessionManifest] = []
    curious = replace(
        TOTAL,
        function="tests.processing.running.test_pipeline:peek",
        makes=(),
        parameters="processing.stages.parameters:StageParameters",
    )
    peek.seen = seen  # type: ignore[attr-defined]
    with pytest.raises(ProcessingError, match="does not name among its needs"):
        run(session, (FRAMES, HALF_OF_NOTHING, curious))
    assert seen[0].frames == ()
    assert seen[0].name == "session"
    assert seen[0].session_id == "ab" * 16


def peek(context: StageContext) -> StageOutput:
    peek.seen.append(context.session)  # type: ignore[attr-defined]
    context.optional_artifact("other", "thing")
    return StageOutput()


HALF_OF_NOTHING = Stage("other", 1, "other", "tests.processing.running.test_pipeline:empty")


def empty(_context: StageContext) -> StageOutput:
    return StageOutput()


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (replace(HALF_OF_NOTHING, makes=(Artifact("thing", "json"),)), "neither made thing"),
        (replace(HALF_OF_NOTHING, makes=(Artifact("thing", "json", optional=True),)), "nor said why not"),
        (replace(FRAMES, makes=FRAMES.makes[:1]), "does not name"),
        (
            replace(FRAMES, makes=(FRAMES.makes[0], Artifact("notes", "file", file_name="n.txt"))),
            "has not written n.txt",
        ),
    ],
)
def test_a_stage_that_breaks_its_row_is_refused(session: Path, row: Stage, words: str) -> None:
    with pytest.raises(ProcessingError, match=words):
        run(session, (row,))


class Answered(StageParameters):
    x: Annotated[Path | None, path_field("answer", "X.", artifact="x")] = None


class Excluding(StageParameters):
    x: Annotated[Path | None, path_field("file", "X.", excludes=["--y"])] = None


class Leaning(StageParameters):
    x: Annotated[Path | None, path_field("file", "X.", beside=["--y"])] = None


def test_tables_that_cannot_be_are_refused() -> None:
    for stages, words in (
        ((FRAMES, FRAMES), "two stages"),
        ((TOTAL,), "no earlier stage"),
        ((replace(FRAMES, parameters=f"{__name__}:Answered"),), "does not make"),
        ((replace(FRAMES, parameters=f"{__name__}:Excluding"),), "which no stage has"),
        ((replace(FRAMES, parameters=f"{__name__}:Leaning"),), "which no stage has"),
    ):
        with pytest.raises(ValueError, match=words):
            check_table(stages)


def test_the_table_is_sound() -> None:
    check_table(STAGES)
    for stage in STAGES:
        assert callable(resolve(stage.function))
        assert issubclass(resolve(stage.parameters), StageParameters)
        resolve(stage.parameters)()
        assert set(stage.reads) <= {"folder", "relight", *SessionManifest.model_fields}
    named = options()
    for stage in STAGES:
        for flag, option in stage.options.items():
            assert named[flag] == option, "two stages mean different things by one flag"
            assert len(option.help) > 5, f"{flag} does not say what it is"
    assert [s.name for s in selected("merge")] == ["verify", "merge"]


def test_stages_that_ask_for_the_sun_see_what_it_is_estimated_from() -> None:
    for name in ("room", "detect"):
        assert {"site", "heading_rad", "frames"} <= set(stage_named(name).reads), name


def test_the_shipped_network_is_an_ingredient_of_what_depends_on_it() -> None:
    """A new network makes rooms and masks of the old one out of date."""
    for name in ("room", "detect"):
        data = stage_named(name).data
        assert {Path(file).suffix for file in data} == {".onnx", ".json"}
        assert all((PROCESSING / file).is_file() for file in data)


def test_a_stage_s_own_data_count(session: Path) -> None:
    with_data = tuple(replace(s, data=("pipeline.py",)) if s.name == "total" else s for s in TOYS)
    run(session)
    assert [str(a) for a in actions(run(session, with_data))] == ["skipped", "ran", "skipped"]
    digest = hashlib.sha256((PROCESSING / "pipeline.py").read_bytes()).hexdigest()
    assert result(session, "total")["ingredients"]["data"] == {"pipeline.py": digest}
    assert [str(a) for a in actions(run(session, with_data))] == ["skipped"] * 3


def test_what_was_relit_counts_where_a_row_reads_it(session: Path) -> None:
    """New summaries and pictures of daylit relight run the stage again; the basis of the light does not count."""
    rows = (replace(FRAMES, reads=(*FRAMES.reads, "relight")),)
    run(session, rows)
    (session / "relight").mkdir()
    (session / "relight" / "basis.npz").write_bytes(b"light")
    assert actions(run(session, rows)) == ["skipped"]
    (session / "relight" / "day.json").write_text("{}")
    assert "relight day.json" in reason(run(session, rows), FRAMES.name)
    assert actions(run(session, rows)) == ["skipped"]


def test_a_result_with_other_empty_fields_is_made_anew() -> None:
    """An ingredient of None that is not there today changes the fingerprint, and nothing that can be reported."""
    then = {"stage": "frames", "trades": {"max_error": None}}
    now = {"stage": "frames", "trades": {"max_error": None, "time_budget": None}}
    result = StageResult.model_construct(fingerprint=digest(then), ingredients=then)
    decision = decide(Stored(result=result), lambda _: now, forced=False)
    assert decision.result is None
    assert "another version" in decision.reason


def test_a_file_that_comes_where_there_was_none_is_what_is_named() -> None:
    """The reason said "changed: data: {} -> none (and 1 more)" after the report's viewer was built."""
    found = changes({"data": {}, "a": {"b": 1}}, {"data": {"viewer.js": "0123"}, "a": {}})
    assert found == [("a b", 1, None), ("data viewer.js", None, "0123")]
