"""Dialect files: the shipped ones against their sources, and a user's own with every mistake named."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.errors import DaylitError
from drivers.meter.dialect import MAX_DIALECT_BYTES, SHIPPED, DialectError, load_dialect
from drivers.meter.dialogue import interpret
from drivers.meter.interface import ReadingStatus
from drivers.meter.ls160 import KonicaMinoltaMeter
from mocks.instruments.serial_port import Piece
from tests.drivers.memory_line import MemoryLine

MINE = r"""
name = "mine"
title = "My meter"
verified = false
source = "me"
range_cd_m2 = [0.1, 1000]
[port]
baud = 9600
[[connect]]
send = "HELLO"
expect = 'HI (?P<model>\w+) (?P<serial>\w+)'
[[measure]]
send = "L?"
expect = '(?P<value>[0-9.]+) (?P<unit>.*)'
[meanings.unit]
cd = "ok"
fL = "wrong_unit"
[errors]
'E\d+' = "error_code"
"""


def write(tmp_path: Path, text: str) -> str:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return str(path)


def test_what_is_verified_and_what_is_assumed() -> None:
    verified = {name for name in SHIPPED if load_dialect(name).verified}
    assert verified == {"ls100", "cs100a"}
    for name in set(SHIPPED) - verified:
        assert "assumed" in load_dialect(name).title
        assert "assumed" in load_dialect(name).source


@pytest.mark.parametrize("name", ["ls100", "cs100a"])
def test_rs232_siblings_are_4800_7e2(name: str) -> None:
    port = load_dialect(name).port
    assert (port.baud, port.data_bits, port.parity, port.stop_bits) == (4800, 7, "even", 2)


def test_ls160_is_found_by_the_ids_of_its_family() -> None:
    assert set(load_dialect("ls160").usb_ids) == {(0x132B, 0x210D), (0x132B, 0x210E)}


# The examples of the LS-100/110 communication manual that are whole lines of a measurement, and its error codes.
@pytest.mark.parametrize(
    ("line", "status", "value"),
    [
        ("OK00,CfPH125.35", ReadingStatus.WRONG_UNIT, ""),
        ("OK00,P% H 83.02", ReadingStatus.WRONG_MODE, ""),
        ("OK00,CcPH125.35", ReadingStatus.OK, "125.35"),
        ("OK00,CcPM  0.35", ReadingStatus.OK, "  0.35"),
        ("OK00,CcPH748000", ReadingStatus.OK, "748000"),
        ("OK00,CcLH125.35", ReadingStatus.WRONG_MODE, ""),
        ("OK00,f, 21.83", ReadingStatus.GARBLED, ""),  # the answer to CMR
        ("OK00,0.990", ReadingStatus.GARBLED, ""),  # the answer to CCR
        ("ER00", ReadingStatus.ERROR_CODE, ""),
        ("ER01", ReadingStatus.ERROR_CODE, ""),
        ("ER10", ReadingStatus.OVER_RANGE, ""),
        ("ER11", ReadingStatus.ERROR_CODE, ""),
        ("ER19", ReadingStatus.OVER_RANGE, ""),
        ("ER20", ReadingStatus.ERROR_CODE, ""),
        ("ER30", ReadingStatus.BATTERY_LOW, ""),
        ("ER99", ReadingStatus.GARBLED, ""),
    ],
)
def test_ls100_lines_of_the_manual(line: str, status: ReadingStatus, value: str) -> None:
    dialect = load_dialect("ls100")
    assert dialect.confirm is not None
    for step in (dialect.measure[0], dialect.confirm):
        answer = interpret(dialect, step, line.encode())
        assert (answer.status, answer.value_text) == (status, value)


@pytest.mark.parametrize(
    ("line", "status", "value"),
    [
        ("OK00, 34.63, .3127, .3290", ReadingStatus.OK, " 34.63"),
        ("OK11, 34.63, .3127, .3290", ReadingStatus.OK, " 34.63"),
        ("OK12, 34.63, .3127, .3290", ReadingStatus.OVER_RANGE, ""),
        ("OK13,  0.00, .3127, .3290", ReadingStatus.UNDER_RANGE, ""),
        ("ER12", ReadingStatus.OVER_RANGE, ""),
        ("OK00, 34.63, .3127", ReadingStatus.GARBLED, ""),
    ],
)
def test_cs100a_lines(line: str, status: ReadingStatus, value: str) -> None:
    dialect = load_dialect("cs100a")
    answer = interpret(dialect, dialect.measure[0], line.encode())
    assert (answer.status, answer.value_text) == (status, value)


class Mine:
    """A meter that speaks `MINE`."""

    line_end = b"\r\n"

    def hear(self, line: bytes, now_s: float) -> list[Piece]:
        return [Piece(0.0, {b"HELLO": b"HI Lumos 0815\r\n", b"L?": b"12.5 cd\r\n"}[line])]


def test_a_users_own_dialect_works(tmp_path: Path) -> None:
    clock = SystemClock()
    meter = KonicaMinoltaMeter(lambda: MemoryLine(Mine(), clock), load_dialect(write(tmp_path, MINE)), clock)
    identity = meter.connect()
    assert (identity.model, identity.serial, identity.dialect_verified) == ("Lumos", "0815", False)
    assert meter.measure().luminance_cd_m2 == 12.5


@pytest.mark.parametrize("value", ["1.2.3", ".", "...", "0.0.0.0"])
def test_what_a_users_form_lets_through_must_still_be_a_number(tmp_path: Path, value: str) -> None:
    dialect = load_dialect(write(tmp_path, MINE))
    assert interpret(dialect, dialect.measure[0], f"{value} cd".encode()).status is ReadingStatus.GARBLED


def test_a_users_form_without_its_number_is_no_reading(tmp_path: Path) -> None:
    """It was a good answer with an empty text for a number, which ended the capture in an internal error."""
    dialect = load_dialect(write(tmp_path, MINE.replace("(?P<value>[0-9.]+)", "(?P<value>[0-9.]+)?")))
    assert interpret(dialect, dialect.measure[0], b" cd").status is ReadingStatus.GARBLED


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("title =", "# title =", "title"),
        ('"mine"', '"Has Spaces"', "name"),
        ("false", '"perhaps"', "verified"),
        ("[port]", "[port]\nparity = 'mark'", "port.parity"),
        ("[port]", "[port]\nbauds = 1", "port.bauds"),
        ("baud = 9600", "baud = 0", "port.baud"),
        ('"L?"', '"L?\\n"', "measure.0.send"),
        ('"L?"', '""', "measure.0.send"),
        ("(?P<value>", "(", "value"),
        ("(?P<value>", "(?P<value>*", "regular expression"),
        ("(?P<unit>", "(?P<colour>", "colour"),
        ("[meanings.unit]", "[meanings.mode]", "unit"),
        ('"wrong_unit"', '"fine"', "meanings.unit.fL"),
        ("'E\\d+'", "'E('", "errors"),
        ("source", 'ask_again = ["X1"]\nsource', "X1"),
        ("[0.1, 1000]", "[1000, 0.1]", "range_cd_m2"),
        ("[0.1, 1000]", "[0.1, nan]", "range_cd_m2"),
        ('[[connect]]\nsend = "HELLO"', '[other]\nsend = "HELLO"', "connect"),
        ("[errors]", "[confirm]\nsend = 'X'\nexpect = 'Y'\n[errors]", "confirm"),
        ("[port]", "[port", "cannot be read"),
    ],
)
def test_every_mistake_is_named_with_file_and_key(tmp_path: Path, old: str, new: str, named: str) -> None:
    assert old in MINE
    with pytest.raises(DialectError, match=r"mine\.toml") as caught:
        load_dialect(write(tmp_path, MINE.replace(old, new, 1)))
    assert named in str(caught.value)


def test_the_example_in_the_guide_is_one(tmp_path: Path) -> None:
    guide = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "meter-dialects.md").read_text("utf-8")
    dialect = load_dialect(write(tmp_path, guide.split("```toml\n")[1].split("```")[0]))
    answer = interpret(dialect, dialect.measure[-1], b"OK00,CcPH 34.63")
    assert (answer.status, answer.value_text) == (ReadingStatus.OK, " 34.63")


def test_missing_too_large_and_not_text(tmp_path: Path) -> None:
    with pytest.raises(DialectError, match="ls100, cs100a, ls160"):
        load_dialect(str(tmp_path / "none.toml"))
    with pytest.raises(DialectError, match="too large"):
        load_dialect(write(tmp_path, "#" * (MAX_DIALECT_BYTES + 1)))
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DialectError, match="cannot be read"):
        load_dialect(str(tmp_path / "mine.toml"))
    with pytest.raises(DaylitError):
        load_dialect(str(tmp_path))


def test_a_file_saved_by_another_editor_is_read(tmp_path: Path) -> None:
    assert load_dialect(write(tmp_path, "\ufeff" + MINE)) == load_dialect(write(tmp_path, MINE))
