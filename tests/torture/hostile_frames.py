"""Mutations of a good frame, by kind: what a bad cable, card, camera or stranger may make of it."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from tests.station.frames.pictures import jpeg

TIME_S = 1 / 4
SIZE = (160, 120)


@dataclass(frozen=True)
class Case:
    """A mutated file, and whether whoever sees only the file must be able to refuse it."""

    kind: str
    data: bytes
    must_refuse: bool


def good_frames() -> list[bytes]:
    """Return good frames of the asked exposure: sequential, progressive, finer, with restart marks."""
    variants: list[dict[str, object]] = [
        {},
        {"progressive": True},
        {"quality": 97, "subsampling": "4:4:4"},
        {"restart_marker_blocks": 5},
    ]
    return [jpeg(TIME_S, **options) for options in variants]


def _flips(data: bytes, rng: random.Random) -> Case:
    out = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return Case("bit flips", bytes(out), must_refuse=False)


def _noise(data: bytes, rng: random.Random) -> Case:
    out = bytearray(data)
    at = rng.randrange(len(out))
    out[at : at + rng.randint(1, 64)] = rng.randbytes(rng.randint(1, 64))
    return Case("noise", bytes(out), must_refuse=False)


def _truncation(data: bytes, rng: random.Random) -> Case:
    return Case("truncation", data[: rng.randrange(len(data))], must_refuse=True)


def _zero_tail(data: bytes, rng: random.Random) -> Case:
    """A file whose last blocks never reached the disk: the size is right, the bytes are zeros."""
    at = rng.randrange(len(data) - 1)
    return Case("zeroed tail", data[:at] + bytes(len(data) - at), must_refuse=True)


def _splice(data: bytes, rng: random.Random) -> Case:
    """Two transfers mixed: the beginning of one frame and the end of another."""
    other = jpeg(rng.choice([1.0, 1 / 15]), seed=rng.randint(2, 5))
    return Case(
        "splice", data[: rng.randrange(2, len(data))] + other[rng.randrange(2, len(other)) :], must_refuse=False
    )


def _joined(data: bytes, rng: random.Random) -> Case:
    other = jpeg(1.0)
    return Case("two files in one", data + other[: rng.randrange(3, len(other))], must_refuse=True)


def _lie(data: bytes, rng: random.Random) -> Case:
    """A sound picture whose EXIF says something other than what was asked."""
    lies: list[dict[str, object]] = [
        {"said_s": TIME_S * 2 ** (rng.choice([-1, 1]) * rng.randint(1, 18) / 3)},
        {"ISO": rng.choice([50, 125, 200, 6400])},
        {"F_NUMBER": rng.choice([1.4, 5.0, 6.3, 11.0])},
        {"WIDTH": rng.choice([159, 320, 6720])},
        {"HEIGHT": rng.choice([1, 121, 3360])},
        {"EXPOSURE": None},
        {"ISO": None},
        {"with_exif": False},
        {"size": rng.choice([(80, 60), (160, 121), (120, 160)])},
        {"TAKEN_TAG": rng.choice(["2023:05:19 15:51:10", "2022:05:19 15:54:10", "2023:02:30 15:54:10"])},
    ]
    return Case("EXIF lie", jpeg(TIME_S, **rng.choice(lies)), must_refuse=True)


def _exif_bytes(data: bytes, rng: random.Random) -> Case:
    """Random bytes in the directories of the EXIF block: loops, counts, offsets, types."""
    out = bytearray(data)
    start = data.index(b"Exif\0\0") + 6
    for _ in range(rng.randint(1, 6)):
        out[start + rng.randrange(180)] = rng.choice([0, 1, 2, 8, 255, rng.randrange(256)])
    return Case("EXIF bytes", bytes(out), must_refuse=False)


def _header_bytes(data: bytes, rng: random.Random) -> Case:
    """Random bytes in the tables and headers behind the EXIF block."""
    out = bytearray(data)
    start = data.index(b"\xff\xdb")
    for _ in range(rng.randint(1, 4)):
        out[start + rng.randrange(620)] = rng.choice([0, 1, 255, rng.randrange(256)])
    return Case("header bytes", bytes(out), must_refuse=False)


def _lost_block(data: bytes, rng: random.Random) -> Case:
    at = rng.randrange(len(data) - 64)
    return Case("lost block", data[:at] + data[at + rng.choice([1, 2, 16, 64]) :], must_refuse=False)


def _stuttered_block(data: bytes, rng: random.Random) -> Case:
    at = rng.randrange(64, len(data))
    return Case("repeated block", data[:at] + data[at - rng.choice([1, 2, 16, 64]) :], must_refuse=False)


KINDS: tuple[Callable[[bytes, random.Random], Case], ...] = (
    _flips,
    _noise,
    _truncation,
    _zero_tail,
    _splice,
    _joined,
    _lie,
    _exif_bytes,
    _header_bytes,
    _lost_block,
    _stuttered_block,
)


def cases(count: int, seed: int) -> Iterator[Case]:
    """Yield ``count`` cases, all kinds in turn; the same for the same seed. None equals its original."""
    rng = random.Random(seed)
    originals = good_frames()
    n_made = 0
    while n_made < count:
        case = KINDS[n_made % len(KINDS)](rng.choice(originals), rng)
        if case.data not in originals:
            n_made += 1
            yield case
