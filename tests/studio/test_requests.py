"""What others send to the studio's server: an answer that says what is wrong, never a crash."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from processing.layout.arrange import arrange
from processing.layout.items import parse_items
from processing.running.corrections import ARRANGEMENT, ESTIMATED
from studio import programs
from studio.server import COOKIE, Door, make_app
from tests.processing.layout.test_arrange import ROOM
from tests.station.session.sessions import complete_session


async def asked(folder: Path, method: str, path: str, body: bytes) -> tuple[int, bytes]:
    """Return status and body of the application's answer to one request of an admitted browser."""
    door, sent = Door({"here:1"}), list[dict[str, Any]]()
    headers = {"host": "here:1", "origin": "http://here:1", "cookie": f"{COOKIE}={door.admit(door.token())}"}
    scope = {
        "type": "http",
        "method": method,
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
        "root_path": "",
        "http_version": "1.1",
        "scheme": "http",
        "server": ("here", 1),
        "client": ("there", 2),
    }

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: Any) -> None:
        sent.append(message)

    await make_app(folder, door)(scope, receive, send)
    return sent[0]["status"], b"".join(one.get("body", b"") for one in sent[1:])


OTHER = [(what, body) for what in ("run", "judge", "live/light") for body in (b"5", b"[]", b"null", b'"places"')]


@pytest.mark.parametrize(("what", "body"), [*OTHER, ("run", b'{"until": ["merge"], "quality": "draft"}')])
def test_json_of_another_type_is_a_bad_request(tmp_path: Path, what: str, body: bytes) -> None:
    session = complete_session(tmp_path / "sessions")
    path = f"/api/sessions/{session.name}/{what}"
    status, answer = asyncio.run(asked(session.parent, "POST", path, body))
    assert status == 400
    assert json.loads(answer)["error"]["message"]


def test_nothing_is_moved_where_nothing_was_placed(tmp_path: Path) -> None:
    session = complete_session(tmp_path / "sessions")
    (session / "stages" / "arrange").mkdir(parents=True)
    found = arrange(ROOM, parse_items("desk"), "standard", n=1)
    found.model_copy(update={"arrangements": ()}).write(session / ESTIMATED[ARRANGEMENT])
    status, answer = asyncio.run(asked(session.parent, "POST", f"/api/sessions/{session.name}/judge", b"{}"))
    assert status == 400
    assert "no arrangement yet" in json.loads(answer)["error"]["message"]


@pytest.mark.parametrize("inner", ["files/" + "a" * 5000, "files/\0", "files/room/" + "b/" * 3000])
def test_a_name_that_no_disk_has_is_a_bad_request(tmp_path: Path, inner: str) -> None:
    session = complete_session(tmp_path / "sessions")
    status, answer = asyncio.run(asked(session.parent, "GET", f"/api/sessions/{session.name}/{inner}", b""))
    assert status == 400
    assert json.loads(answer)["error"]["message"].startswith("the request cannot be read")


ECHO = """
import json, os, sys
for line in sys.stdin: print(json.dumps(json.loads(line) | {"pid": os.getpid(), "bytes": 0}), flush=True)
"""
"""Instead of the program that previews: it says what it was asked, and who it is."""


def test_the_program_that_previews_goes_on_with_another_session_and_is_begun_anew_when_it_died(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To import what it needs takes longer than most previews. A request cannot name a session of its own."""
    start, started = asyncio.create_subprocess_exec, list[asyncio.subprocess.Process]()

    async def echoing(*command: str, **pipes: Any) -> asyncio.subprocess.Process:
        assert command[-1] == str(tmp_path)
        started.append(await start(sys.executable, "-S", "-c", ECHO, **pipes))
        return started[-1]

    monkeypatch.setattr(programs.asyncio, "create_subprocess_exec", echoing)

    async def asked_for_three() -> list[dict[str, Any]]:
        warm, found = programs.Warm(), list[dict[str, Any]]()
        for name in ("one", "two", "three"):
            if name == "three":
                started[0].kill()
                await started[0].wait()
            found.append((await warm.ask(tmp_path / name, {"do": "light", "session": "another"}))[0])
        warm.stop()
        for program in started:
            program._transport.close()
            await program.wait()
        return found

    first, second, third = asyncio.run(asked_for_three())
    assert [one["session"] for one in (first, second, third)] == ["one", "two", "three"]
    assert first["pid"] == second["pid"] != third["pid"]
