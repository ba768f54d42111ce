"""`daylit view`: finds the page, opens it, says where it is."""

from __future__ import annotations

import json
import webbrowser
from pathlib import Path

import pytest

from daylit import main


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What browsers were asked for; none is started."""
    found: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda uri: found.append(uri) or True)
    return found


@pytest.fixture
def session(tmp_path: Path) -> Path:
    page = tmp_path / "a session" / "stages" / "report" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text("<!doctype html>")
    return tmp_path / "a session"


def test_it_opens_the_page_and_prints_where_it_is(
    session: Path, asked: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    page = session / "stages" / "report" / "index.html"
    for named in (session, page, page.parent):
        assert main(["view", str(named)]) == 0
        assert capsys.readouterr().out.strip() == str(page)
    assert asked == [page.as_uri()] * 3
    assert "%20" in asked[0]


def test_it_opens_nothing_when_not_asked(session: Path, asked: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", "--no-open", str(session)]) == 0
    assert main(["view", "--json", str(session)]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["ok"]
    assert result["report"].endswith("index.html")
    assert result["bytes"] == 15
    assert not asked


def test_without_a_report_it_says_what_to_do(
    tmp_path: Path, asked: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(tmp_path)]) == 4
    assert "name a session folder" in capsys.readouterr().err
    assert not asked
