"""The studio's server: for one browser user on this computer, or one whom a one-time link lets in.

Every request needs a Host that the server has, and the cookie that a one-time token was exchanged for; writing ones an
Origin of its own. Nothing is allowed to other origins, and pages may load nothing but what the server gives.
"""

import asyncio
import json
import re
import secrets
import shlex
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

from starlette import responses
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from drivers.errors import DaylitError
from processing.errors import ParameterError
from processing.running import corrections, screens
from station.session import strict_json
from studio import sessions as seen
from studio.programs import Instruments, Jobs, Warm

STATIC = Path(__file__).parent / "static"
COOKIE = "daylit"
MOST_BYTES = 64 << 20  # of an upload: a painted mask of full size has a hundredth (chosen)
MOST_IMPORT_BYTES = 4 << 30  # of what is imported (chosen: as much as a zip of a browser's own can hold)
LOOK_S = 0.4  # from one look at a session's stamp to the next (chosen: people wait for it, the disk does not)
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' blob: data:; "
    "connect-src 'self' blob: data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
HEADERS = [
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]
_CORRECTIONS = {Path(name).stem: name for name in (*corrections.ESTIMATED, *corrections.LAYERS)}


class Door:
    """Who may come in: tokens that count once, and the cookies that they were exchanged for."""

    def __init__(self, hosts: set[str]) -> None:
        self.hosts = hosts
        self._tokens: set[str] = set()
        self._cookies: set[str] = set()

    def token(self) -> str:
        """Return a new token, good for one browser."""
        self._tokens.add(token := secrets.token_urlsafe(24))
        return token

    def admit(self, token: str) -> str | None:
        """Return a cookie for a token that was not used yet."""
        if token not in self._tokens:
            return None
        self._tokens.discard(token)
        self._cookies.add(cookie := secrets.token_urlsafe(24))
        return cookie

    def known(self, cookie: str | None) -> bool:
        """Return whether a cookie was given to somebody."""
        return cookie is not None and cookie in self._cookies


class Guard:
    """Turns away whoever the door does not know, before anything is read or routed."""

    def __init__(self, app: ASGIApp, door: Door) -> None:
        self._app, self._door = app, door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or let the application answer, with the headers that every answer has."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *HEADERS]
            await send(message)

        await (self._refused(Request(scope)) or self._app)(scope, receive, with_headers)

    def _refused(self, request: Request) -> Response | None:
        host = request.headers.get("host", "")
        if host not in self._door.hosts:
            return PlainTextResponse("unknown host", 421)
        if request.method not in ("GET", "HEAD") and request.headers.get("origin") != f"http://{host}":
            return PlainTextResponse("another origin", 403)
        most = MOST_IMPORT_BYTES if request.url.path == "/api/import" else MOST_BYTES
        if int(request.headers.get("content-length") or 0) > most:
            return PlainTextResponse("too large", 413)
        if request.url.path == "/" and (token := request.query_params.get("token")):
            cookie = self._door.admit(token)
            if cookie:
                answer = responses.RedirectResponse("/", 303)
                answer.set_cookie(COOKIE, cookie, httponly=True, samesite="strict", path="/")
                return answer
        if not self._door.known(request.cookies.get(COOKIE)):
            text = "This link is invalid or already used. daylit studio prints a new one each time it starts."
            return PlainTextResponse(text, 403)
        return None


class Studio:
    """The routes over a folder of sessions."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.jobs = Jobs()
        self.warm = Warm()
        self.rig = Instruments(folder)

    def session(self, request: Request) -> Path:
        """Return the session that the address names."""
        return seen.session_at(self.folder, request.path_params["name"])

    def answer(self, read: Callable[[Path], Any]) -> Callable[[Request], Awaitable[Response]]:
        """Return what answers with what is read of a session."""

        async def handler(request: Request) -> Response:
            return JSONResponse(await run_in_threadpool(read, self.session(request)))

        return handler

    async def index(self, _request: Request) -> Response:
        """Return the page."""
        return responses.FileResponse(STATIC / "index.html")

    async def cards(self, _request: Request) -> Response:
        """Return the folder's sessions."""
        folder, found = shlex.quote(str(self.folder)), await run_in_threadpool(seen.cards, self.folder)
        return JSONResponse({"folder": folder, "sessions": found, "job": self.jobs.state(self.folder)})

    async def begin(self, request: Request) -> Response:
        """Begin a capture into the folder."""
        async with self.rig.turn:
            await self.jobs.start(self.folder, strict_json.loads(await _body(request)))
        return JSONResponse(self.jobs.state(self.folder))

    async def instruments(self, request: Request) -> Response:
        """Return the instruments with battery, card and clock."""
        world = request.query_params.get("simulate", "")

        def capturing() -> bool:
            return bool((self.jobs.state(self.folder) or {}).get("running")) or seen.captured(self.folder)

        return JSONResponse(await self.rig.state(world, capturing=capturing))

    async def bring(self, request: Request) -> Response:
        """Take a session's zip, or a panorama, into the folder."""
        name = request.query_params.get("name", "")
        if not re.fullmatch(r"[^./\\\x00-\x1f][^/\\\x00-\x1f]{0,119}", name):
            raise ParameterError("not a file name", where="import", advice="give it a plain name")
        with tempfile.TemporaryDirectory(prefix=".import-", dir=self.folder) as place:
            with (path := Path(place) / name).open("wb") as file:
                async for part in _parts(request, MOST_IMPORT_BYTES):
                    file.write(part)
            return JSONResponse({"name": (await run_in_threadpool(seen.brought, path, self.folder)).name})

    async def overview(self, request: Request) -> Response:
        """Return what there is of a session."""
        session = self.session(request)
        found = await run_in_threadpool(seen.overview, session)
        return JSONResponse({**found, "path": shlex.quote(str(session)), "job": self.jobs.state(session)})

    async def picture(self, request: Request) -> Response:
        """Return a panorama of the room."""
        width = min(4096, max(64, int(request.query_params.get("width", "2048"))))
        state = request.query_params.get("state", "Photograph")
        data = await run_in_threadpool(screens.picture_jpeg, self.session(request), state, width)
        return Response(data, media_type="image/jpeg")

    async def viewer(self, request: Request) -> Response:
        """Return a state with its numbers, for the probe."""
        state = request.query_params.get("state", "Photograph")
        text = await run_in_threadpool(screens.viewer_json, self.session(request), state)
        return Response(text, media_type="application/json")

    async def frame(self, request: Request) -> Response:
        """Return a frame, small."""
        file = request.query_params.get("file", "")
        data = await run_in_threadpool(screens.frame_jpeg, self.session(request), file, 480)
        return Response(data, media_type="image/jpeg")

    async def file(self, request: Request) -> Response:
        """Return a result as a file; the report as the page that it is."""
        session, inner = self.session(request), request.path_params["path"]
        path = (session / "stages" / inner).resolve()
        if not path.is_relative_to((session / "stages").resolve()) or not path.is_file():
            return PlainTextResponse("no such file", 404)
        return responses.FileResponse(path, filename=path.name)

    async def correction(self, request: Request) -> Response:
        """Read, write or forget the room, the mask or the arrangement."""
        session, name = self.session(request), _CORRECTIONS[request.path_params["what"]]
        if request.method == "DELETE":
            await run_in_threadpool(seen.drop, session, name)
        elif request.method == "PUT":
            base = request.query_params.get("base", "")
            data = await _body(request)
            await run_in_threadpool(lambda: seen.save(session, name, _file_of(session, name, data), base))
        data, corrected = await run_in_threadpool(corrections.current, session, name)
        if not data:
            raise ParameterError("not available yet", where=name)
        kind = "image/png" if name.endswith(".png") else "application/json"
        state = {"x-digest": seen.digest(data), "x-corrected": str(int(corrected))}
        return Response(data, media_type=kind, headers=state)

    async def judge(self, request: Request) -> Response:
        """Return the rules that an arrangement breaks, while a piece is dragged."""
        session, places = self.session(request), strict_json.loads(await _body(request))
        made = await run_in_threadpool(corrections.moved, session, places)
        broken = await run_in_threadpool(lambda: corrections.broken(corrections.plan_of(session), made.arrangements[0]))
        return JSONResponse({"broken": broken})

    async def live(self, request: Request) -> Response:
        """Return a preview: the emptied room, another light, a region's figures, glare at a seat."""
        session, asked = self.session(request), strict_json.loads(await _body(request))
        if "places" in asked:
            found = await run_in_threadpool(corrections.moved, session, asked.pop("places"))
            asked["items"] = [item.model_dump(mode="json") for item in found.arrangements[0].items]
        facts, data = await self.warm.ask(session, {**asked, "do": request.path_params["what"]})
        if "error" in facts:
            return JSONResponse(facts, 400)
        if not data:
            return JSONResponse(facts)
        return Response(data, media_type=facts["media"], headers={"x-facts": json.dumps(facts)})

    async def run(self, request: Request) -> Response:
        """Begin a run, or stop it."""
        session = self.session(request)
        if request.method == "DELETE":
            self.jobs.stop(session)
        else:
            await self.jobs.start(session, strict_json.loads(await _body(request)))
        return JSONResponse(self.jobs.state(session))

    async def events(self, request: Request) -> Response:
        """Send the session's stamp and its run whenever one of them changes."""
        session = self.session(request)
        return responses.StreamingResponse(self._changes(request, session), media_type="text/event-stream")

    async def _changes(self, request: Request, session: Path) -> AsyncIterator[str]:
        last = ""
        while not await request.is_disconnected():
            text = json.dumps({"stamp": await run_in_threadpool(seen.stamp, session), "job": self.jobs.state(session)})
            if text != last:
                yield f"data: {text}\n\n"
                last = text
            await asyncio.sleep(LOOK_S)


def _file_of(session: Path, name: str, data: bytes) -> bytes:
    """Return what was sent as the file to write, checked."""
    if name.endswith(".png"):
        return corrections.mask_bytes(data, session)
    value = strict_json.loads(data)
    if name == corrections.ROOM:
        return corrections.room_bytes(value)
    found = corrections.moved(session, value)
    if rules := corrections.broken(corrections.plan_of(session), found.arrangements[0]):
        raise ParameterError(f"not allowed: {rules[0]}", where="furnish", advice="move it until all rules are met")
    return (found.model_dump_json(indent=1) + "\n").encode()


async def _body(request: Request) -> bytes:
    """Return what was sent, up to `MOST_BYTES`."""
    return b"".join([part async for part in _parts(request, MOST_BYTES)])


async def _parts(request: Request, most: int) -> AsyncIterator[bytes]:
    async for part in request.stream():
        most -= len(part)
        if most < 0:
            raise ParameterError("too large", where="upload")
        yield part


async def _error_answer(_request: Request, error: Exception) -> Response:
    if isinstance(error, DaylitError):
        status = 409 if isinstance(error, seen.StaleError) else 404 if error.code == "SES-001" else 400
        return JSONResponse({"error": error.to_dict()}, status)
    return JSONResponse({"error": {"code": "USE-001", "message": f"the request cannot be read: {error}"[:200]}}, 400)


def make_app(folder: Path, door: Door) -> Starlette:
    """Return the application over a folder of sessions."""
    studio = Studio(folder)
    base = "/api/sessions/{name}"
    routes = [
        Route("/", studio.index),
        Mount("/static", StaticFiles(directory=STATIC, check_dir=False)),
        Route("/api/sessions", studio.cards),
        Route("/api/import", studio.bring, methods=["POST"]),
        Route("/api/capture", studio.begin, methods=["POST"]),
        Route("/api/instruments", studio.instruments),
        Route(base, studio.overview),
        Route(base + "/picture", studio.picture),
        Route(base + "/viewer", studio.viewer),
        Route(base + "/frame", studio.frame),
        Route(base + "/capture", studio.answer(seen.capture_state)),
        Route(base + "/designs", studio.answer(corrections.designs)),
        Route(base + "/judge", studio.judge, methods=["POST"]),
        Route(base + "/live/{what:str}", studio.live, methods=["POST"]),
        Route(base + "/run", studio.run, methods=["POST", "DELETE"]),
        Route(base + "/events", studio.events),
        Route(base + "/files/{path:path}", studio.file),
        Route(base + "/correction/{what:str}", studio.correction, methods=["GET", "PUT", "DELETE"]),
    ]
    unfit = (DaylitError, OSError, ValueError, LookupError, TypeError, AttributeError)
    errors: dict[Any, Any] = dict.fromkeys(unfit, _error_answer)
    return Starlette(routes=routes, middleware=[Middleware(Guard, door=door)], exception_handlers=errors)
