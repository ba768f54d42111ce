"""`daylit process` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest

import daylit
import processing.pipeline
from processing.commands.process import PlainView, TerminalView, process, stage_view
from processing.running import runner
from processing.running.results import Action, RunEvent, RunEventKind, StageReport
from station.commands.views import answer, numbers, printable
from tests.processing.running import toy_stages
from tests.processing.running.toy_stages import TOTAL, TOYS
from tests.station.session.sessions import complete_session


@pytest.fixture(autouse=True)
def _toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_STATE", str(tmp_path / "state"))
    monkeypatch.setattr(processing.pipeline, "STAGES", TOYS)
    monkeypatch.setattr(processing.pipeline.options, "__defaults__", (TOYS,))
    monkeypatch.setattr(processing.pipeline.trades, "__defaults__", (TOYS,))
    monkeypatch.setitem(runner.process.__kwdefaults__, "stages", TOYS)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return complete_session(tmp_path / "sessions")


def test_first_and_second_run(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["process", str(session)]) == 0
    first = capsys.readouterr().out
    assert "frames: a number a frame (no result yet)" in first
    assert "left out: extra: nobody asked" in first
    assert "warning: a toy (toy)" in first
    assert "quality: standard" in first
    assert "3 of 3 stages done in" in first
    assert "peak memory" in first
    assert daylit.main(["process", str(session)]) == 0
    second = capsys.readouterr().out
    assert second.count("no input has changed") == 3
    assert "nothing to do" in second


def test_a_report_of_another_run_is_not_given_out_as_this_ones(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """After `--until calibrate --k1 2` the report of the options before was named as what came of them."""
    page = session / "stages" / "report" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text("of other options")
    assert daylit.main(["process", str(session)]) == 0
    assert "report:" not in capsys.readouterr().out


@pytest.mark.parametrize(("name", "done"), [("frames", 0), ("total", 1)])
def test_ctrl_c_keeps_what_is_finished(
    session: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str, done: int
) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as now:
        now.setattr(toy_stages, name, interrupted)
        assert daylit.main(["process", str(session)]) == 130
    said = capsys.readouterr().err
    assert f"{name}: stopped; finished stages are kept, the same command goes on from here" in said
    assert not list((session / "stages").glob(".part*"))
    assert daylit.main(["process", str(session)]) == 0
    assert f"{3 - done} of 3 stages done" in capsys.readouterr().out


def test_options_of_stages_reach_them_and_are_explained(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["process", str(session), "--json"]) == 0
    capsys.readouterr()
    assert daylit.main(["process", str(session), "--scale", "2", "--rounds", "4", "--explain", "--dry-run"]) == 0
    result = capsys.readouterr().out
    assert "would run" in result
    assert "parameters rounds: 3 -> 4" in result
    assert daylit.main(["process", str(session), "--scale", "2", "--max-error", "0.02", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is True
    assert [s["action"] for s in report["stages"]] == ["skipped", "ran", "ran"]
    assert {"what": "parameters scale", "old": 1.0, "new": 2.0} in report["stages"][1]["changes"]
    assert report["stages"][1]["cost"]["peak_bytes"] > 0


def test_the_run_says_who_honoured_a_trade(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["process", str(session), "--time-budget", "5"]) == 0
    assert "--time-budget 5: used by no stage; not supported by the others" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "exit_code", "words"),
    [
        (["--until", "roof"], 2, "no such stage: 'roof'"),
        (["--scale", "much"], 2, "--scale"),
        (["--k9", "1"], 2, "--k9"),
        (["--total", "none.json"], 2, "no file none.json"),
        (["--max-error", "7"], 2, "out of range"),
        (["--until", "frames", "--scale", "2"], 2, "does not apply to any stage of this run"),
    ],
)
def test_errors_are_usage_errors(
    session: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], exit_code: int, words: str
) -> None:
    assert daylit.main(["process", str(session), *arguments]) == exit_code
    assert words in capsys.readouterr().err


def test_only_what_a_stage_does_is_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    def flags() -> set[str]:
        context = click.Context(process)
        return {opt for param in process.get_params(context) for opt in param.opts}

    assert {"--scale", "--total", "--rounds", "--quality", "--max-error", "--time-budget"} <= flags()
    only = (TOYS[0],)
    monkeypatch.setattr(processing.pipeline, "STAGES", only)
    monkeypatch.setattr(processing.pipeline.options, "__defaults__", (only,))
    monkeypatch.setattr(processing.pipeline.trades, "__defaults__", (only,))
    assert not flags() & {"--scale", "--total", "--max-error", "--time-budget"}
    assert flags() >= {"--rounds", "--quality", "--json", "--until"}
    assert next(iter(TOTAL.options)) == "--scale"


def test_views(capsys: pytest.CaptureFixture[str]) -> None:
    assert isinstance(stage_view(), PlainView), "standard output is no terminal here"
    with TerminalView() as view:
        view.show(RunEvent(RunEventKind.STARTED, "merge", "merge", left_s=200.0))
        view.show(RunEvent(RunEventKind.PROGRESS, "merge", "[bold]half", 0.5, 30.0))
        view.show(RunEvent(RunEventKind.FINISHED, "merge", "done", 1.0))
    capsys.readouterr()
    PlainView().show(RunEvent(RunEventKind.STARTED, "merge", "x\x1b[2J", left_s=100.0))
    assert capsys.readouterr().out == "merge: x?[2J, about 2 min left\n"
    assert printable("a\tb\n") == "a?b?"


def test_help_lists_options_stage_by_stage(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["process", "--help"]) == 0
    result = capsys.readouterr().out
    sections = [line for line in result.splitlines() if line and not line.startswith(" ")]
    own = [stage for stage in TOYS if stage.options]
    assert sections[-len(own) :] == [f"{stage.name}: {stage.title}:" for stage in own]
    for stage in own:
        for flag in stage.options:
            assert result.count(f"  {flag} ") == 1
    assert "[SESSION]" not in result.partition("Options:")[2]


def test_the_session_remembers_options(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["process", str(session), "--scale", "2", "--quality", "draft"]) == 0
    capsys.readouterr()
    assert daylit.main(["process", str(session)]) == 0
    out = capsys.readouterr().out
    assert "saved options: --quality draft, --scale 2.0" in out
    assert "nothing to do" in out
    assert daylit.main(["process", str(session), "--forget", "scale", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [s["action"] for s in report["stages"]] == ["skipped", "ran", "ran"]
    assert report["choices"] == {"went_on_with": {"quality": "draft"}, "notes": []}
    daylit.process(session, scale=3.0)
    assert daylit.open_session(session).choices == {"quality": "draft", "scale": 3.0}


def test_choices_show_the_time_of_the_places_clocks(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of Pittsburgh where the session says so, of a zone that was chosen, else UTC."""
    from station.session.session import Site
    from station.session.store import load_manifest

    daylit.main(["choices", str(session), "scale=2"])
    daylit.main(["choices", str(session), "scale=3", "--past"])
    assert capsys.readouterr().out.count(" UTC") == 3
    there = load_manifest(session).model_copy(update={"site": Site(latitude_deg=40.44, longitude_deg=-79.99)})
    (session / "session.json").write_text(there.model_dump_json())
    daylit.main(["choices", str(session), "--past"])
    shown = capsys.readouterr().out
    assert shown.count(" EST") + shown.count(" EDT") == 2
    assert " UTC" not in shown
    daylit.main(["choices", str(session), "zone=Asia/Tokyo"])
    assert capsys.readouterr().out.count(" JST") == 2


@pytest.mark.parametrize("pair", ["quality=zzz", "max-error=9", "total=nosuch.json"])
def test_a_choice_that_no_run_could_go_on_with_is_not_saved(
    pair: str, session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Any word was taken, with exit code 0, and the next run or batch was refused."""
    assert daylit.main(["choices", str(session), pair]) == 2
    capsys.readouterr()
    assert daylit.main(["choices", str(session)]) == 0
    assert "no saved options" in capsys.readouterr().out


def test_choices_are_shown_set_and_dropped(session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["choices", str(session)]) == 0
    assert "no saved options" in capsys.readouterr().out
    factor = tmp_path / "factor.txt"
    factor.write_text("2")
    assert daylit.main(["choices", str(session), "scale=2", f"factor={factor}"]) == 0
    assert daylit.main(["choices", str(session), "scale=3"]) == 0
    assert daylit.main(["choices", str(session), "--past"]) == 0
    out = capsys.readouterr().out
    assert "factor.txt" in out
    assert "(choices/" in out
    assert "daylit choices" in out
    assert "scale 2.0" in out.splitlines()[-1]
    assert daylit.main(["choices", str(session), "--forget", "all", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["chosen"] == {}
    assert daylit.main(["choices", str(session), "scale"]) == 2
    assert "'scale' is not NAME=VALUE" in capsys.readouterr().err


def test_answers_are_json_that_everyone_reads(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer({"a": float("inf"), "b": [float("nan"), 1.5], "c": "NaN"}, (), as_json=True, exit_code=1) == 1
    assert capsys.readouterr().out == '{"a": null, "b": [null, 1.5], "c": "NaN"}\n'


def test_one_number_is_asked_for_in_the_singular() -> None:
    with pytest.raises(click.UsageError, match="one finite number, cd/m2"):
        numbers("--scale", "nan", 1, "cd/m2")
    with pytest.raises(click.UsageError, match="2 comma-separated numbers"):
        numbers("--at", "1", 2, "degrees")


def test_where_a_stage_fails_what_those_before_warned_of_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    view = PlainView()
    summary = {"warnings": [{"message": "a frame is off", "code": "toy"}], "left_out": {"sky": "none"}}
    view.show(
        RunEvent(RunEventKind.FINISHED, "frames", "", report=StageReport("frames", Action.RAN, "", (), None, summary))
    )
    assert capsys.readouterr().err == ""
    view.show(RunEvent(RunEventKind.FAILED, "total", "no"))
    assert capsys.readouterr().err.strip() == "warning: a frame is off (toy)"
