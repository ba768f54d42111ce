"""A million serial lines, spoiled in every way: no number that the meter did not send.

Ground rule: a spoiled line may pass only if it is, byte for byte, a line that the meter could have sent as a live
plain luminance; on a line without a checksum nothing better is possible. What a real line adds is parity: a byte with
one flipped bit arrives as NUL (`drivers.serial_link` asks the system for that), which is what ``parity`` does here.
"""

from __future__ import annotations

import os
import random
import re
import time

from drivers.meter.dialect import load_dialect
from drivers.meter.dialogue import interpret
from drivers.meter.interface import ReadingStatus
from tests.torture.ledger import record

LINES = 1_000_000 if os.environ.get("DAYLIT_TORTURE") else 20_000
ORACLE = {
    # Written from the instruments' manuals: flags by position, then six columns, right-justified digits and one point.
    "ls100": lambda t: t[:9] == "OK00,CcPH" and len(t) == 15 and _number(t[9:]),
    "ls160": lambda t: t[:5] in ("OK00,", "OK03,") and len(t) == 62 and _number(t[27:38].rstrip(" ")),
    "cs2000": lambda t: t[:5] == "OK00," and t.count(",") == 3 and _number(t[5:].split(",")[0]),
    "ca410": lambda t: t[:8] == "OK00,P1," and 5 <= t.count(",") <= 7 and _number(t.split(",")[5]),
    "cs100a": lambda t: t[:5] in ("OK00,", "OK11,") and t.count(",") == 3 and _number(t[5:].split(",")[0]),
}


def _number(field: str) -> bool:
    digits = field.lstrip(" ")
    return re.fullmatch(r"\+?\d+(\.\d*)?([eE][+-]\d\d)?", digits) is not None


def valid_line(rng: random.Random, language: str) -> bytes:
    value = 10 ** rng.uniform(-1, 5)
    number = f"{value:.2f}"[:6].rstrip(".")
    if language == "ls100":
        return f"OK00,CcP{rng.choice('HM')}{number:>6}".encode()
    if language == "ls160":
        return f"OK00,0,0,0,01,0,0,00,00000,{number:>11},     0.3127,     0.3290".encode()
    if language == "cs2000":
        return f"OK00,{float(number):.4e},3.1270e-01,3.2900e-01".encode()
    if language == "ca410":
        return f"OK00,P1,0,0.3362781,0.3559744,{number},-0.01,-99999999".encode()
    return f"OK00,{number:>6}, .3127, .3290".encode()


def parity(rng: random.Random, line: bytes) -> bytes:
    place = rng.randrange(len(line))
    return line[:place] + b"\0" + line[place + 1 :]


def flip(rng: random.Random, line: bytes) -> bytes:
    """Flip two bits of one byte: parity does not see that."""
    place = rng.randrange(len(line))
    bits = rng.sample(range(7), 2)
    return line[:place] + bytes([line[place] ^ 1 << bits[0] ^ 1 << bits[1]]) + line[place + 1 :]


def drop(rng: random.Random, line: bytes) -> bytes:
    place = rng.randrange(len(line))
    return line[:place] + line[place + rng.randrange(1, 4) :]


def insert(rng: random.Random, line: bytes) -> bytes:
    place = rng.randrange(len(line) + 1)
    return line[:place] + rng.randbytes(rng.randrange(1, 4)) + line[place:]


def swap(rng: random.Random, line: bytes) -> bytes:
    place = rng.randrange(len(line) - 1)
    return line[:place] + line[place + 1 : place + 2] + line[place : place + 1] + line[place + 2 :]


WAYS = [
    parity,
    flip,
    drop,
    insert,
    swap,
    lambda rng, line: line[: rng.randrange(len(line))],
    lambda rng, line: line + line[rng.randrange(len(line)) :],
    lambda rng, line: b"MES" + line,
    lambda rng, line: line.replace(b"Cc", rng.choice([b"Cf", b"C%", b"Pc", b"P%"])).replace(b"OK00,0", b"OK00,1"),
    lambda rng, line: rng.choice([b"ER10", b"ER19", b"ER30", b"ER00", b"OK12", b"OK01", b"OK00"]),
    lambda rng, line: rng.randbytes(rng.randrange(0, 60)),
    lambda rng, line: b"U" * rng.randrange(60, 10_240),
    lambda rng, line: line.lower(),
]


def test_no_wrong_number_among_spoiled_lines() -> None:
    seed = 20261121
    rng = random.Random(seed)
    dialects = {name: load_dialect(name) for name in ORACLE}
    start_s = time.perf_counter()
    numbers, wrong, indistinguishable = 0, [], 0
    for index in range(LINES):
        language = tuple(ORACLE)[index % len(ORACLE)]
        sent = valid_line(rng, language)
        line = sent if index % 20 == 0 else rng.choice(WAYS)(rng, sent)
        answer = interpret(dialects[language], dialects[language].measure[-1], line)
        if answer.status is not ReadingStatus.OK:
            assert line != sent or not ORACLE[language](line.decode("ascii", "replace")), f"good line refused: {line!r}"
            continue
        numbers += 1
        text = line.decode("ascii")
        text = text.strip("\r\n") if len(dialects[language].line_end) == 1 else text
        if not (ORACLE[language](text) or (language == "ls100" and ORACLE[language](text[:8] + "H" + text[9:]))):
            wrong.append(line)
        elif line != sent:
            indistinguishable += 1
    seconds = time.perf_counter() - start_s
    notes = f"{numbers} numbers; {indistinguishable} spoiled lines that are well-formed lines of the meter"
    record(
        "serial lines",
        injected=LINES,
        observed=LINES - numbers,
        lost=len(wrong),
        seconds=seconds,
        seed=seed,
        notes=notes,
    )
    assert not wrong, wrong[:5]
    assert numbers > LINES / 40, "the good lines among them must pass"


def test_parity_errors_never_pass() -> None:
    """What the system hands on for a byte with a wrong parity bit makes every line invalid."""
    rng = random.Random(7)
    dialect = load_dialect("ls100")
    for _ in range(5_000):
        line = parity(rng, valid_line(rng, "ls100"))
        assert interpret(dialect, dialect.measure[0], line).status is not ReadingStatus.OK
