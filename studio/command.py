"""``daylit studio``: sessions in the browser, to see and to correct."""

import socket
import webbrowser
from pathlib import Path

import click

from station.commands.views import answer, parameters


@click.command(params=parameters(__package__, "studio"))
def studio(folder: Path, *, port: int, phone: bool, show: bool, as_json: bool) -> int:
    """View the sessions in FOLDER and correct rooms, masks and furniture by hand.

    Only this computer can connect, and only through the printed link, which works once. Corrections are saved with the
    session as soon as they are made; killing the server loses nothing.

    \b
    Examples:
      daylit studio
      daylit studio sessions --phone
    """
    import uvicorn

    from processing.errors import ParameterError
    from studio.server import STATIC, Door, make_app

    if not folder.is_dir():
        raise ParameterError("no such folder", where=str(folder), advice="give the sessions folder")
    if not (STATIC / "index.html").is_file():
        advice = "run make web (in the checkout; needs the npm registry once), or install a wheel, which includes it"
        raise ParameterError("the studio's pages were not built during set-up", where=str(STATIC), advice=advice)
    sockets = [listening("127.0.0.1", port)]
    port = sockets[0].getsockname()[1]
    hosts = [f"127.0.0.1:{port}", f"localhost:{port}"]
    if phone:
        sockets.append(listening(_own_address(), port))
        hosts.append(f"{sockets[1].getsockname()[0]}:{port}")
    door = Door(set(hosts))
    links = [f"http://{host}/?token={door.token()}" for host in (hosts[0], *hosts[2:])]
    lines = [f"{what}: {link}" for what, link in zip(("studio", "on a phone"), links, strict=False)]
    answer({"ok": True, "links": links}, [*lines, "each link works once; stop with Ctrl-C"], as_json=as_json)
    if show:
        webbrowser.open(links[0])
    config = uvicorn.Config(make_app(folder.resolve(), door), log_level="warning", timeout_graceful_shutdown=1)
    uvicorn.Server(config).run(sockets=sockets)
    return 0


def listening(address: str, port: int) -> socket.socket:
    """Return a socket that takes connections; raises `ParameterError` where the port is taken or forbidden."""
    from processing.errors import ParameterError

    opened = socket.socket()
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    # An answer's body waits 40 ms for the client to confirm its headers otherwise; connections inherit it.
    opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    try:
        opened.bind((address, port))
        opened.listen(128)  # whoever follows a link at once waits, and is not refused
    except OSError as error:
        opened.close()
        raise ParameterError(f"--port {port}: {error.strerror}", where=address, advice="give another --port") from error
    return opened


def _own_address() -> str:
    """Return this computer's address on the network that its default route leads to; nothing is sent."""
    from processing.errors import ParameterError

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # of documentation (RFC 5737): nobody has it
        except OSError as error:
            raise ParameterError("--phone: this computer is not on a network", where="studio") from error
        return str(probe.getsockname()[0])
