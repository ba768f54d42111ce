"""The gate before the decoder: what cameras write passes, everything else is refused with its reason."""

from __future__ import annotations

import io
import random
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from station.frames.jpeg import MAX_SCANS, MAX_SEGMENTS, read_header
from station.frames.problems import FrameProblemError, Reason
from tests.station.frames.pictures import jpeg

PLAIN = jpeg()


def segment(marker: int, payload: bytes) -> bytes:
    return bytes([0xFF, marker]) + (len(payload) + 2).to_bytes(2, "big") + payload


def at_marker(data: bytes, marker: int) -> int:
    """Return where a segment starts, walking the segments as T.81 B.1.1.4 says."""
    position = 2
    while data[position + 1] != marker:
        position += 2 + int.from_bytes(data[position + 2 : position + 4], "big")
    return position


def patched(data: bytes, at: int, value: bytes) -> bytes:
    return data[:at] + value + data[at + len(value) :]


def refused(data: bytes) -> Reason:
    with pytest.raises(FrameProblemError) as caught:
        read_header(data)
    assert caught.value.message
    return caught.value.reason


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"progressive": True},
        {"optimize": True},
        {"subsampling": "4:4:4"},
        {"subsampling": "4:2:0"},
        {"restart_marker_blocks": 3},
        {"with_exif": False},
        {"quality": 1},
        {"quality": 100},
    ],
)
def test_what_cameras_write_passes(options):
    header = read_header(jpeg(**options))
    assert (header.width_px, header.height_px) == (160, 120)
    assert header.progressive == options.get("progressive", False)
    assert (header.exif is None) == (options.get("with_exif") is False)
    assert header.notes == ()


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 90), st.integers(1, 90), st.booleans(), st.sampled_from(["4:4:4", "4:2:0"]))
def test_the_smallest_pictures_have_enough_data(width, height, progressive, subsampling):
    """The lower bound on the data must hold for what compresses best: one colour, optimised codes."""
    flat = np.full((height, width, 3), 128, np.uint8)
    data = jpeg(picture=flat, with_exif=False, progressive=progressive, subsampling=subsampling, optimize=True)
    header = read_header(data)
    assert (header.width_px, header.height_px) == (width, height)


@pytest.mark.parametrize("progressive", [False, True])
def test_every_truncation_is_refused(progressive):
    data = jpeg(size=(40, 24), progressive=progressive)
    reasons = {refused(data[:length]) for length in range(len(data))}
    assert reasons == {Reason.NOT_JPEG, Reason.TRUNCATED}


@pytest.mark.parametrize("progressive", [False, True])
def test_cut_and_closed_again_is_refused_when_too_little_is_left(progressive):
    data = jpeg(size=(400, 300), progressive=progressive)
    start = at_marker(data, 0xDA) + 30
    assert refused(data[:start] + b"\xff\xd9") is Reason.TRUNCATED


@pytest.mark.parametrize("data", [b"", b"\0" * 5000, b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"GIF89a", PLAIN[1:]])
def test_other_files_are_not_jpeg(data):
    assert refused(data) is Reason.NOT_JPEG


@pytest.mark.parametrize("mode", ["L", "CMYK"])
def test_other_colour_spaces_are_unsupported(mode):
    buffer = io.BytesIO()
    Image.new(mode, (64, 64)).save(buffer, "JPEG")
    assert refused(buffer.getvalue()) is Reason.UNSUPPORTED


@pytest.mark.parametrize(
    "marker", [0xC3, 0xC5, 0xC6, 0xC7, 0xC8, 0xC9, 0xCA, 0xCB, 0xCC, 0xCD, 0xCE, 0xCF, 0xDC, 0xDE, 0xDF]
)
def test_codings_of_no_camera_are_unsupported(marker):
    data = patched(PLAIN, at_marker(PLAIN, 0xC0) + 1, bytes([marker]))
    assert refused(data) is Reason.UNSUPPORTED


def test_frame_header_out_of_range():
    sof = at_marker(PLAIN, 0xC0)
    assert refused(patched(PLAIN, sof + 4, b"\x0c")) is Reason.UNSUPPORTED  # 12 bits
    assert refused(patched(PLAIN, sof + 5, b"\0\0")) is Reason.DAMAGED  # no height
    assert refused(patched(PLAIN, sof + 5, b"\xff\xff\xff\xff")) is Reason.TOO_LARGE
    assert refused(patched(PLAIN, sof + 11, b"\x50")) is Reason.DAMAGED  # sampling 5x0
    assert refused(patched(PLAIN, sof + 13, PLAIN[sof + 10 : sof + 11])) is Reason.DAMAGED  # a name twice


def test_a_bomb_of_few_bytes_is_refused_before_decoding():
    sof = at_marker(PLAIN, 0xC0)
    assert refused(patched(PLAIN, sof + 5, (12_000).to_bytes(2, "big") * 2)) is Reason.TRUNCATED


def test_two_frame_headers_or_scans_are_refused():
    sof, sos = at_marker(PLAIN, 0xC0), at_marker(PLAIN, 0xDA)
    header = PLAIN[sof : sof + 19]
    assert refused(PLAIN[:sof] + header + PLAIN[sof:]) is Reason.DAMAGED
    assert refused(PLAIN[:-2] + PLAIN[sos:]) is Reason.DAMAGED
    assert refused(PLAIN[:sof] + PLAIN[sof + 19 :]) is Reason.DAMAGED  # a scan without frame header


def test_missing_and_doubled_components_are_refused():
    sos = at_marker(PLAIN, 0xDA)
    two = segment(0xDA, bytes([2, 1, 0, 2, 0x11, 0, 63, 0]))
    assert refused(PLAIN[:sos] + two + PLAIN[sos + 14 :]) is Reason.TRUNCATED
    doubled = segment(0xDA, bytes([3, 1, 0, 1, 0, 2, 0x11, 0, 63, 0]))
    assert refused(PLAIN[:sos] + doubled + PLAIN[sos + 14 :]) is Reason.DAMAGED


def test_bytes_behind_the_picture():
    assert refused(PLAIN + b"x") is Reason.TRAILING_DATA
    assert refused(PLAIN + PLAIN) is Reason.TRAILING_DATA
    assert "padding" in read_header(PLAIN + b"\0" * 512).notes[0]
    announced = PLAIN[:2] + segment(0xE2, b"MPF\0" + b"\0" * 20) + PLAIN[2:]
    assert "previews" in read_header(announced + PLAIN).notes[0]
    assert refused(announced + b"x") is Reason.TRAILING_DATA


def test_two_exif_segments_are_refused():
    app1 = at_marker(PLAIN, 0xE1)
    length = 2 + int.from_bytes(PLAIN[app1 + 2 : app1 + 4], "big")
    assert refused(PLAIN[:2] + PLAIN[app1 : app1 + length] + PLAIN[2:]) is Reason.EXIF_DAMAGED


def test_endless_segments_and_scans_are_bounded():
    comments = segment(0xFE, b"")
    assert read_header(PLAIN[:2] + comments * 100 + PLAIN[2:]).width_px == 160
    assert refused(PLAIN[:2] + comments * MAX_SEGMENTS + PLAIN[2:]) is Reason.DAMAGED
    data = jpeg(progressive=True, size=(40, 24))
    scan = segment(0xDA, bytes([1, 1, 0, 1, 63, 0])) + b"\0"
    assert refused(data[:-2] + scan * MAX_SCANS + b"\xff\xd9") is Reason.DAMAGED


def test_fill_bytes_before_markers_are_allowed():
    sof = at_marker(PLAIN, 0xC0)
    assert read_header(PLAIN[:sof] + b"\xff" * 9 + PLAIN[sof:]).width_px == 160


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 12))
def test_whatever_the_bytes_a_named_reason_or_a_sound_header(seed, n_changes):
    rng = random.Random(seed)
    data = bytearray(PLAIN)
    for _ in range(n_changes):
        at = rng.randrange(min(len(data), 700))
        data[at] = rng.randrange(256)
    with suppress(FrameProblemError):
        header = read_header(bytes(data))
        assert 0 < header.width_px * header.height_px <= 200_000_000


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=300))
def test_noise_behind_a_start_of_image_is_refused(noise):
    assert refused(b"\xff\xd8\xff" + noise.replace(b"\xff\xd9", b"")) in Reason
