"""Opening ONNX networks: what cannot be opened is reported by the caller's own error."""

from __future__ import annotations

from pathlib import Path

import pytest

from processing.errors import FillerError
from processing.segmentation import segmenters
from processing.segmentation.segmenters import open_session

TOY = Path(__file__).resolve().parents[1] / "room" / "networks" / "led2net.onnx"


def refused(what: str) -> FillerError:
    return FillerError(what, where="here")


def test_a_network_is_opened_from_a_file_and_from_its_bytes() -> None:
    for data in (TOY, TOY.read_bytes()):
        assert len(open_session(data, refused, repeatable=True).get_inputs()) == 1


def test_what_cannot_be_opened_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(FillerError, match="cannot be read: No such file"):
        open_session(tmp_path / "none.onnx", refused)
    with pytest.raises(FillerError, match="cannot be read: Is a directory"):
        open_session(tmp_path, refused)
    for junk in (b"", b"no network", TOY.read_bytes()[:200]):
        (tmp_path / "junk.onnx").write_bytes(junk)
        with pytest.raises(FillerError, match="cannot be loaded"):
            open_session(tmp_path / "junk.onnx", refused)
    monkeypatch.setattr(segmenters, "MOST_BYTES", 5)
    with pytest.raises(FillerError, match="larger than 5 bytes"):
        open_session(TOY, refused)
