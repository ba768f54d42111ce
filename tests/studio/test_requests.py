"""What others send to the studio's server: an answer that says what is wrong, never a crash."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from studio.server import COOKIE, Door, make_app
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


OTHER = [(what, body) for what in ("run", "judge", "live/light") for body in (b"5", b"[]", b"null", b'"x"')]


@pytest.mark.parametrize(("what", "body"), [*OTHER, ("run", b'{"until": ["merge"], "quality": "draft"}')])
def test_json_of_another_type_is_a_bad_request(tmp_path: Path, what: str, body: bytes) -> None:
    session = complete_session(tmp_path / "sessions")
    path = f"/api/sessions/{session.name}/{what}"
    status, answer = asyncio.run(asked(session.parent, "POST", path, body))
    assert status == 400
    assert json.loads(answer)["error"]["message"]
