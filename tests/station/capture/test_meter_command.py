"""``daylit meter`` against a meter behind a pseudo-terminal."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import daylit
from drivers.transcript import read_transcript
from mocks.instruments.ls160 import MeterFault, MeterFaultKind, SimulatedMeter
from mocks.instruments.serial_port import SerialPort
from tests.mocks.instruments.recorded_meter import RecordedMeter

Plug = Callable[..., str]


@pytest.fixture
def plug() -> Iterator[Plug]:
    """Plug a meter in; returns the name of its port."""
    ports: list[SerialPort] = []

    def plug_in(**how: object) -> str:
        meter = SimulatedMeter(lambda _t: 1019.0, measuring_s=0.02, **how)  # type: ignore[arg-type]
        ports.append(SerialPort(meter))
        return ports[-1].name

    yield plug_in
    for port in ports:
        port.close()


def test_read_as_json(plug: Plug, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["meter", "read", "--port", plug(), "--dialect", "ls100", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"]
    assert answer["luminance_cd_m2"] == pytest.approx(1019.0, rel=1e-2)
    assert answer["dialect_verified"] is True
    assert answer["n_samples"] >= 3


def test_read_says_that_the_dialect_is_assumed(plug: Plug, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["meter", "read", "--port", plug(language="ls160"), "--samples", "1"]) == 0
    result = capsys.readouterr().out
    assert "cd/m2" in result
    assert "ASSUMED" in result


def test_a_status_is_no_number_and_not_a_success(plug: Plug, capsys: pytest.CaptureFixture[str]) -> None:
    port = plug(faults=(MeterFault(MeterFaultKind.UNIT_FL),))
    assert daylit.main(["meter", "read", "--port", port, "--dialect", "ls100", "--json"]) == 3
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] is False
    assert answer["status"] == "wrong_unit"
    assert answer["luminance_cd_m2"] is None


def test_no_such_port_and_no_such_dialect(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["meter", "read", "--port", "/dev/no-such-port", "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "DEV-001"
    assert daylit.main(["meter", "read", "--dialect", "klingon", "--json"]) == 2
    assert "klingon" in json.loads(capsys.readouterr().out)["error"]["where"]


def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Little waiting, one port setting: a pseudo-terminal takes any."""
    from drivers.meter import probe

    monkeypatch.setattr(probe, "ANSWER_LIMIT_S", 0.15)
    monkeypatch.setattr(probe, "MEASURING_LIMIT_S", 0.4)
    monkeypatch.setattr(probe, "AFTER_S", 0.05)
    monkeypatch.setattr(probe, "SETTINGS", probe.SETTINGS[:1])


def test_probe_writes_a_transcript_once_and_names_the_dialect(
    plug: Plug, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    quick(monkeypatch)
    path = tmp_path / "transcript.jsonl"
    command = ["meter", "probe", str(path), "--port", plug(language="cs2000"), "--json"]
    assert daylit.main(command) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["answers"] > 0
    assert [fit["dialect"] for fit in answer["fits"] if fit["luminance_cd_m2"]] == ["cs2000"]
    text = path.read_text()
    assert {entry.way for entry in read_transcript(path)} >= {"open", "out", "in", "close"}
    assert daylit.main(command) == 2, "an old transcript is not overwritten"
    assert path.read_text() == text

    monkeypatch.undo()
    port = SerialPort(RecordedMeter(read_transcript(path)))
    try:
        capsys.readouterr()
        assert (
            daylit.main(["meter", "read", "--port", port.name, "--dialect", "cs2000", "--samples", "1", "--json"]) == 0
        )
        assert json.loads(capsys.readouterr().out)["luminance_cd_m2"] == pytest.approx(1019.0, rel=1e-2)
    finally:
        port.close()


def test_a_time_limit_is_a_finite_number(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["meter", "read", "--timeout", "nan"]) == 2
    assert "not a finite number" in capsys.readouterr().err


def test_probe_names_a_transcript_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["meter", "probe", str(tmp_path / "no folder" / "t.jsonl"), "--port", "/dev/null"]) == 6
    assert "create the folder" in capsys.readouterr().err


def test_probe_says_on_the_screen_what_fits_and_that_nothing_answers(
    plug: Plug, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    quick(monkeypatch)
    assert daylit.main(["meter", "probe", str(tmp_path / "a"), "--port", plug(language="ls100")]) == 0
    said = capsys.readouterr().out
    assert "OK00,CcPH" in said
    assert 'dialect = "ls100" gives 10' in said
    port = SerialPort(RecordedMeter([]))
    try:
        assert daylit.main(["meter", "probe", str(tmp_path / "b"), "--port", port.name]) == 3
    finally:
        port.close()
