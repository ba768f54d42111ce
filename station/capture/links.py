"""How a rig's links are opened: as they are, written down in a transcript, or replayed from one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING

from pydantic import ValidationError

from drivers.clock import Clock, SystemClock
from drivers.errors import ProtocolViolationError
from station.capture.rig_file import RigFile
from station.session import durable
from station.session.session import Side

if TYPE_CHECKING:
    from drivers.ptp.pipes import PtpTransport
    from drivers.replay import ReplayedLine, ReplayedTransport
    from drivers.serial_link import ByteLine
    from drivers.transcript import Entry, Transcript

RECORDED = "recorded:"  # before the name of a transcript in ``--simulate``
RIG, METER = "rig", "meter"  # who a transcript names beside the sides: the rig it was made with, and the meter


class Links:
    """Opens links; `close` when the rig is closed.

    ``transcript`` and its ``file``: what goes over the links is written there. ``entries``: by who, of a transcript
    that is replayed; no instrument is opened then. ``simulated``: whether the instruments are, or were.
    """

    def __init__(
        self,
        clock: Clock | None = None,
        *,
        transcript: Transcript | None = None,
        file: IO[str] | None = None,
        entries: Mapping[str, Sequence[Entry]] | None = None,
        simulated: bool = False,
    ) -> None:
        self.simulated = simulated
        self._clock = clock or SystemClock()
        self._transcript = transcript
        self._file = file
        self._entries = entries
        self._cameras: dict[str, ReplayedTransport] = {}
        self._meter: ReplayedLine | None = None

    def camera(self, side: Side, open_link: Callable[[], PtpTransport]) -> PtpTransport:
        """Return a camera's link, opened anew; a replay goes on where it stands."""
        from drivers.replay import ReplayedTransport
        from drivers.transcript import RecordedTransport

        who = side.value
        if self._entries is not None:
            if who not in self._cameras:
                self._cameras[who] = ReplayedTransport(self._entries[who], self._clock, who)
            return self._cameras[who]
        link = open_link()
        return link if self._transcript is None else RecordedTransport(link, self._transcript, who)

    def meter(self, open_link: Callable[[], ByteLine], settings: str) -> ByteLine:
        """Return the meter's line, opened anew; ``settings`` of its port in words."""
        from drivers.replay import ReplayedLine
        from drivers.transcript import RecordedLine

        if self._entries is not None:
            self._meter = self._meter or ReplayedLine(self._entries[METER], self._clock, METER)
            return self._meter
        line = open_link()
        return line if self._transcript is None else RecordedLine(line, self._transcript, METER, settings)

    def close(self) -> None:
        """Close the transcript; `ResourceError` where not all of it was written."""
        if self._file is not None and self._transcript is not None:
            with durable.disk_errors(Path(self._file.name), "recording"):
                self._file.close()
                if self._transcript.problem is not None:
                    raise self._transcript.problem


def open_links(record: Path | None, rig: RigFile, clock: Clock, *, simulated: bool) -> Links:
    """Return links that write a new transcript (none without ``record``); it begins with the rig, less its place.

    Raises `UsageError, ResourceError`: the file is there already, or cannot be written.
    """
    if record is None:
        return Links(clock, simulated=simulated)
    from drivers.transcript import Transcript

    file = durable.new_file(record)  # closed with the links
    transcript = Transcript(file, clock)
    table = rig.model_dump(mode="json", exclude={"site", "heading_deg"})
    transcript.write(RIG, "open", info={"rig": table, "simulated": simulated})
    return Links(clock, transcript=transcript, file=file, simulated=simulated)


def replayed_links(path: Path) -> tuple[Links, RigFile]:
    """Return links that replay a transcript, and the rig it was made with, of the instruments that are in it.

    Raises `ProtocolViolationError`: no transcript, or one without its rig.
    """
    from drivers.transcript import read_transcript

    entries: dict[str, list[Entry]] = defaultdict(list)
    for entry in read_transcript(path):
        entries[entry.who].append(entry)
    try:
        made_with = entries[RIG][0].info
        rig = RigFile.model_validate(made_with["rig"])
        simulated = bool(made_with["simulated"])
    except (IndexError, KeyError, ValidationError) as error:
        text = "does not start with the rig it was recorded with"
        advice = "record it with: daylit conform --record FILE"
        raise ProtocolViolationError(text, where=str(path), advice=advice) from error
    missing = {who: None for who in (*map(str, Side), METER) if who not in entries}
    return Links(entries=entries, simulated=simulated), rig.model_copy(update=missing)
