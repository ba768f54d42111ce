"""How ONNX networks are opened: on the processor, a few threads, silent, and never from files beside them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from processing.ground.threads import threads as most_threads

MOST_BYTES = 2 << 30
_TOLD = 300
"""Characters of the runtime's message that are passed on."""


def open_session(
    data: Path | bytes, refused: Callable[[str], Exception], *, threads: int = 1, repeatable: bool = False
) -> Any:
    """Return onnxruntime's session of a network in a file, or of its bytes.

    Parameters
    ----------
    data
        Bytes where the caller has checked what they are. Weights in files beside the network are not read: only what
        is given is opened.
    refused
        Makes the caller's typed error of what is wrong: raised for a file that cannot be read, is larger than 2 GiB,
        or is no network.
    repeatable
        Ask for kernels that give the same answer each time, though they may be slower.
    """
    import onnxruntime as ort

    network = data if isinstance(data, bytes) else _bytes(data, refused)
    asked = ort.SessionOptions()
    asked.intra_op_num_threads, asked.inter_op_num_threads = min(threads, most_threads()), 1
    asked.use_deterministic_compute = repeatable
    asked.log_severity_level = 3
    try:
        return ort.InferenceSession(network, asked, providers=["CPUExecutionProvider"])
    # onnxruntime's errors have no common base of their own.
    except Exception as exc:
        raise refused(f"cannot be loaded: {str(exc)[:_TOLD]}") from exc


def _bytes(path: Path, refused: Callable[[str], Exception]) -> bytes:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise refused(f"larger than {MOST_BYTES} bytes")
        return path.read_bytes()
    except OSError as exc:
        raise refused(f"cannot be read: {exc.strerror}") from exc
