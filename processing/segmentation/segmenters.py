"""Networks that segment views: ONNX through onnxruntime, TensorFlow Lite through ai-edge-litert."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from processing.errors import SegmenterError
from processing.ground.arrays import AnyArray, Bytes, Floats
from processing.ground.threads import threads as most_threads
from processing.segmentation.adapters import NetworkContract, network_input, read_contract, scene_probabilities

THREADS = 2  # chosen, never swept

# How ONNX networks are opened: on the processor, a few threads, silent, and never from files beside them.

MOST_BYTES = 2 << 30
_TOLD = 300  # characters of the runtime's message that are passed on


def open_session(
    data: Path | bytes, refused: Callable[[str], Exception], *, threads: int = 1, repeatable: bool = False
) -> Any:
    """Return onnxruntime's session of a network in a file, or of its bytes.

    ``data``: bytes where the caller has checked what they are. Weights in files beside the network are not read: only
      what is given is opened.
    ``refused``: makes the caller's typed error of what is wrong: raised for a file that cannot be read, is larger than
      2 GiB, or is no network.
    ``repeatable``: ask for kernels that give the same answer each time, though they may be slower.
    """
    import onnxruntime as ort

    try:
        if isinstance(data, Path) and data.stat().st_size > MOST_BYTES:
            raise refused(f"larger than {MOST_BYTES} bytes")
        network = data.read_bytes() if isinstance(data, Path) else data
    except OSError as exc:
        raise refused(f"cannot be read: {exc.strerror}") from exc
    asked = ort.SessionOptions()
    asked.intra_op_num_threads, asked.inter_op_num_threads = min(threads, most_threads()), 1
    asked.use_deterministic_compute = repeatable
    asked.log_severity_level = 3
    asked.enable_cpu_mem_arena = False  # it would keep 200 MB that one picture takes
    try:
        return ort.InferenceSession(network, asked, providers=["CPUExecutionProvider"])
    # onnxruntime's errors have no common base of their own.
    except Exception as exc:
        raise refused(f"cannot be loaded: {str(exc)[:_TOLD]}") from exc


class Segmenter(Protocol):
    """What `processing.segmentation.around` asks of a network."""

    @property
    def name(self) -> str:
        """Network and version."""

    @property
    def size_px(self) -> int:
        """Side of the views it likes best."""

    @property
    def fixed_size(self) -> bool:
        """Whether it takes no other."""

    def probabilities(self, view_rgb8: Bytes) -> Floats:
        """Return (H', W', len(SceneClass)) of an sRGB view (H, W, 3); each pixel sums to 1."""


class _ByContract(ABC):
    """A network that is fed and read as its contract says; names and, on a grey view, its output are checked first."""

    contract: NetworkContract

    def _check(self, path: Path, inputs: list[str], outputs: list[str]) -> None:
        """Raise `SegmenterError` unless the network has what its contract names, and keeps it."""
        asked = {"input": ((self.contract.input,), inputs), "outputs": (self.contract.outputs, outputs)}
        for key, (names, there) in asked.items():
            missing = [name for name in names if name not in there]
            if missing:
                text, advice = f"{key}: the network has no {', '.join(missing)}", f"it has: {', '.join(there)}"
                raise SegmenterError(text, where=str(path), advice=advice)
        side = self.size_px
        grey = np.random.default_rng(0).integers(96, 160, (side, side, 3)).astype(np.uint8)
        try:
            self.probabilities(grey)
        except SegmenterError as error:
            text = f"breaks its contract: {error.message}"
            raise SegmenterError(text, where=str(path), likely=error.likely, advice=error.advice) from error

    @property
    def name(self) -> str:
        """Return the contract's name."""
        return self.contract.name

    @property
    def size_px(self) -> int:
        """Return the side of the views it likes best."""
        return self.contract.size_px

    @property
    def fixed_size(self) -> bool:
        """Return whether it takes no other."""
        return self.contract.fixed_size

    def probabilities(self, view_rgb8: Bytes) -> Floats:
        """Return (H', W', len(SceneClass)) of an sRGB view (H, W, 3); `SegmenterError` where the network fails."""
        try:
            found = self._outputs_of(network_input(self.contract, view_rgb8))
        # Runtimes' errors have no common base.
        except Exception as exc:
            raise _failed(self.contract, view_rgb8, exc) from exc
        return scene_probabilities(self.contract, found, view_rgb8.shape[:2])

    @abstractmethod
    def _outputs_of(self, fed: AnyArray) -> list[AnyArray]:
        """Return the outputs that the contract names, in its order."""


class OnnxSegmenter(_ByContract):
    """An ONNX network."""

    def __init__(self, path: Path, contract: NetworkContract, *, threads: int = THREADS) -> None:
        """Load and check; `SegmenterError` says what does not fit."""
        self.contract = contract
        self._session = open_session(path, lambda what: _unreadable(path, what), threads=threads)
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        self._check(path, [one.name for one in inputs], [one.name for one in outputs])

    def _outputs_of(self, fed: AnyArray) -> list[AnyArray]:
        return list(self._session.run(list(self.contract.outputs), {self.contract.input: fed}))


class TfliteSegmenter(_ByContract):
    """A TensorFlow Lite network, of fixed size whatever its contract says; outputs may be inner tensors."""

    def __init__(self, path: Path, contract: NetworkContract, *, threads: int = THREADS) -> None:
        """Load and check; `SegmenterError` says what does not fit."""
        from ai_edge_litert.interpreter import Interpreter

        self.contract = contract
        try:
            network = _with_outputs(path.read_bytes(), contract.outputs)
            self._network: Any = Interpreter(model_content=network, num_threads=threads)
            self._network.allocate_tensors()
        # What a damaged file raises while it is parsed has no common base.
        except Exception as exc:
            raise _unreadable(path, f"cannot be loaded: {str(exc)[:300]}") from exc
        self._inputs = {one["name"]: one["index"] for one in self._network.get_input_details()}
        self._outputs = {one["name"]: one for one in self._network.get_output_details()}
        self._check(path, list(self._inputs), list(self._outputs))

    @property
    def fixed_size(self) -> bool:
        """Return True: no other size."""
        return True

    def _outputs_of(self, fed: AnyArray) -> list[AnyArray]:
        self._network.set_tensor(self._inputs[self.contract.input], fed)
        self._network.invoke()
        return [self._output(self._outputs[name]) for name in self.contract.outputs]

    def _output(self, tensor: Any) -> AnyArray:
        """Return an output's values; quantised ones as the real numbers that they stand for."""
        values: AnyArray = self._network.get_tensor(tensor["index"])
        scale, zero = tensor["quantization"]
        return (values.astype(np.float32) - zero) * np.float32(scale) if scale else values


def _with_outputs(network: bytes, names: tuple[str, ...]) -> bytes:
    """Return a TensorFlow Lite file that gives inner tensors of those names in place of as many of its outputs.

    So class scores can be read of networks that end in class numbers. Names that it does not have change nothing."""
    from ai_edge_litert.schema_py_generated import Model

    changed = bytearray(network)
    graph = Model.GetRootAs(changed, 0).Subgraphs(0)
    tensors = [(graph.Tensors(i).Name() or b"").decode() for i in range(graph.TensorsLength())]
    # A view of the file's own bytes: the numbers of the output tensors.
    outputs = graph.OutputsAsNumpy()
    given = [tensors[number] for number in outputs]
    if not set(given) & set(names) and set(names) <= set(tensors) and len(names) <= len(given):
        outputs[: len(names)] = [tensors.index(name) for name in names]
    return bytes(changed)


def open_segmenter(
    path: Path, contract: Path | None = None, *, threads: int = THREADS
) -> OnnxSegmenter | TfliteSegmenter:
    """Return the network in a file (.onnx or .tflite); its contract lies beside it as NAME.json unless given.

    Raises `SegmenterError`: no such file, of another kind, a contract that cannot be right or is not kept.
    """
    ending = path.suffix.lower()
    if ending not in (".onnx", ".tflite"):
        raise SegmenterError(f"a network in a file {path.name}", where=str(path), advice="give .onnx or .tflite")
    if not path.is_file():
        raise SegmenterError("no such network", where=str(path))
    declared = read_contract(contract or path.with_suffix(".json"))
    if ending == ".onnx":
        return OnnxSegmenter(path, declared, threads=threads)
    return TfliteSegmenter(path, declared, threads=threads)


def _unreadable(path: Path, what: str) -> SegmenterError:
    likely = "the file is damaged, a pointer to it, or newer than the runtime"
    return SegmenterError(f"the network {what}", where=str(path), likely=likely)


def _failed(contract: NetworkContract, view_rgb8: Bytes, exc: Exception) -> SegmenterError:
    text = f"the network rejects a view of {view_rgb8.shape[0]} x {view_rgb8.shape[1]}: {str(exc)[:300]}"
    likely = "the contract declares a wrong size, layout or type of input"
    advice = "correct size_px, layout or input_type in the contract"
    return SegmenterError(text, where=contract.name, likely=likely, advice=advice)
