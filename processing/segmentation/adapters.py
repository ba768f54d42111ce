"""What a segmentation network takes and gives, declared, so that any of three kinds of output becomes our classes.

A contract is a small JSON file beside the network. It says how a view becomes the input and what the output is: class
scores per pixel, class numbers per pixel, or queries with masks (as MaskFormer and its kin give). Nothing is guessed:
what does not fit its contract is refused by name.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from processing.errors import SegmenterError
from processing.ground.arrays import AnyArray, Bytes, Floats, Rgb
from processing.ground.tables import table_of
from processing.segmentation.evidence import SceneClass
from station.session import strict_json

# What the classes of known data sets are to us.


Table = Mapping[str, tuple[SceneClass, ...]]  # a network's class name -> ours; several: it may be any of them

_LETTERS: Table = {
    letter: tuple(SceneClass[name.upper()] for name in names)
    for letter, names in table_of(__package__, "classes")["letters"].items()
}
MAX_CONTRACT_BYTES = 1 << 20
IGNORED_LABEL = 255  # of class maps: by custom, a pixel that no class is given to, unless there are so many classes
UNKNOWN = 1.0 / len(SceneClass)

Name = Annotated[str, Field(min_length=1, max_length=200)]
Kind = Literal["floor", "wall", "ceiling", "window", "door", "furniture", "fixture", "tripod"]


def _table(name: str) -> Table:
    """Return the classes "name:letter, ..." of a data set in index order."""
    pairs = (entry.split(":") for entry in " ".join(table_of(__package__, "classes")[name].split()).split(", "))
    return {name: _LETTERS[letter] for name, letter in pairs}


ADE20K_TABLE = _table("ade20k")
"""Cabinets and shelves are furniture, though some are built in: what is missed stays in the picture for good."""
ADE20K = tuple(ADE20K_TABLE)  # the 150 names, index 0..149 (dataset label minus 1: label 0 is "other")

VOC_TABLE = _table("voc")  # VOC knows no floor, wall or window: its background is anything but furniture
VOC = tuple(VOC_TABLE)  # the 21 names, index 0..20

KNOWN: Mapping[str, tuple[tuple[str, ...], Table]] = {"ade20k": (ADE20K, ADE20K_TABLE), "voc": (VOC, VOC_TABLE)}
"""Names in index order and their table, by data set."""


def class_matrix(names: Sequence[str], table: Table) -> Floats:
    """Return (len(names), len(SceneClass)): row n spreads class n's probability over ours; rows sum to 1.

    Raises `SegmenterError`: a name that the table does not know; all such are named.
    """
    unknown = [name for name in names if not table.get(name)]
    if unknown:
        text = f"classes without a meaning: {', '.join(unknown[:8])}" + (" ..." if len(unknown) > 8 else "")
        likely = "another data set's names, or a background class that is not listed"
        advice = "say in the contract's meanings what they are"
        raise SegmenterError(text, likely=likely, advice=advice, classes=unknown)
    matrix = np.zeros((len(names), len(SceneClass)), dtype=np.float32)
    for row, name in enumerate(names):
        for kind in table[name]:
            matrix[row, kind] = 1 / len(table[name])
    return matrix


# Contracts.


class NetworkContract(BaseModel):
    """How to feed a network a view, and how to read what it gives."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: Name
    """Network and version, for the record."""
    input: Name
    layout: Literal["NCHW", "NHWC"] = "NCHW"
    input_type: Literal["float32", "uint8"] = "float32"
    order: Literal["RGB", "BGR"] = "RGB"
    input_range: Literal[1, 255] = 1
    """White is 1 or 255 before mean and std."""
    mean: Rgb = (0.0, 0.0, 0.0)
    """In the network's channel order and range; taken off before dividing by ``std``."""
    std: Rgb = (1.0, 1.0, 1.0)
    size_px: Annotated[int, Field(ge=16, le=4096)] = 512
    """Side of the square views that the network is fed."""
    size_multiple: Annotated[int, Field(ge=1, le=1024)] = 1
    fixed_size: bool = True
    """Whether the network takes ``size_px`` only."""
    classes: Literal["ade20k", "voc"] | Annotated[tuple[Name, ...], Field(min_length=2, max_length=4096)]
    """A known data set, or the names in index order."""
    meanings: Mapping[str, Kind | tuple[Kind, ...]] = {}
    """What names are to us, where the known tables do not know them or say otherwise."""
    output: Literal["logits", "probabilities", "argmax", "queries"]
    outputs: Annotated[tuple[Name, ...], Field(min_length=1, max_length=2)]
    """Names; of queries: class logits [Q, C + 1] (the last is "no object"), then mask logits [Q, h, w]."""
    output_stride: Annotated[int, Field(ge=1, le=64)] = 1
    """Input pixels to an output pixel."""
    first_label: Literal[0, 1] = 0
    """Number of the first named class: 1 where 0 stands for "other" (labels not reduced)."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.size_px % self.size_multiple:
            raise ValueError(f"size_px {self.size_px} is not a multiple of {self.size_multiple}")
        if len(self.outputs) != (2 if self.output == "queries" else 1):
            raise ValueError("queries have two outputs (classes, masks), all others one")
        if min(self.std) <= 0:
            raise ValueError("std must be above 0")
        if self.input_type == "uint8" and (self.mean, self.std, self.input_range) != ((0,) * 3, (1,) * 3, 255):
            raise ValueError("an input of uint8 is fed 0..255 as it is: input_range 255, no mean and std")
        return self

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names of the classes in index order."""
        return KNOWN[self.classes][0] if isinstance(self.classes, str) else self.classes

    @cached_property
    def matrix(self) -> Floats:
        """Return (classes, len(SceneClass)), rows sum to 1; `SegmenterError` names classes without a meaning."""
        known = KNOWN[self.classes][1] if isinstance(self.classes, str) else {**VOC_TABLE, **ADE20K_TABLE}
        own: dict[str, tuple[SceneClass, ...]] = {
            name: tuple(SceneClass[kind.upper()] for kind in ((kinds,) if isinstance(kinds, str) else kinds))
            for name, kinds in self.meanings.items()
        }
        return class_matrix(self.names, {**known, **own})


def read_contract(path: Path) -> NetworkContract:
    """Return the contract in a JSON file; `SegmenterError` names the file and what is wrong with it."""
    try:
        raw = path.read_bytes()
        if len(raw) > MAX_CONTRACT_BYTES:
            raise strict_json.StrictJsonError(f"larger than {MAX_CONTRACT_BYTES} bytes")
        contract = NetworkContract.model_validate_json(json.dumps(strict_json.loads(raw)))
    except OSError as exc:
        text = f"the network's contract cannot be read: {exc.strerror}"
        advice = "put a JSON file of that name beside the network; docs/reference/detection.md has examples"
        raise SegmenterError(text, where=str(path), advice=advice) from exc
    except strict_json.StrictJsonError as exc:
        raise SegmenterError(str(exc), where=str(path), advice="correct the file") from exc
    except ValidationError as exc:
        raise SegmenterError(strict_json.faults_of(exc)[0], where=str(path), advice="correct this key") from exc
    contract.matrix  # noqa: B018 (names without a meaning are reported now, not in the middle of a run)
    return contract


def network_input(contract: NetworkContract, view_rgb8: Bytes) -> AnyArray:
    """Return what the network is fed for one sRGB view (H, W, 3): with a batch axis, in the declared layout."""
    picture = view_rgb8 if contract.order == "RGB" else view_rgb8[..., ::-1]
    if contract.input_type == "float32":
        scale = 1 / 255 if contract.input_range == 1 else 1.0
        mean, std = np.array(contract.mean, np.float32), np.array(contract.std, np.float32)
        fed: AnyArray = ((picture.astype(np.float32) * np.float32(scale)) - mean) / std
    else:
        fed = picture
    if contract.layout == "NCHW":
        fed = fed.transpose(2, 0, 1)
    return np.ascontiguousarray(fed[None])


def scene_probabilities(contract: NetworkContract, outputs: Sequence[AnyArray], size_px: tuple[int, int]) -> Floats:
    """Return (H', W', len(SceneClass)) of one view of height and width ``size_px``; each pixel sums to 1.

    Raises `SegmenterError`: an output of another shape, number of classes or stride than declared, or values that
    cannot be.
    """
    given = [np.asarray(output) for output in outputs]
    if contract.output == "argmax":
        found = _of_labels(contract, _without_batch(contract, given[0], 2))
    elif contract.output == "queries":
        found = _of_queries(contract, _without_batch(contract, given[0], 2), _without_batch(contract, given[1], 3))
    else:
        found = _of_scores(contract, _without_batch(contract, given[0], 3))
    expected = tuple(-(-side // contract.output_stride) for side in size_px)
    if any(abs(side - asked) > 1 for side, asked in zip(found.shape[:2], expected, strict=True)):
        text = f"the output is {found.shape[0]} x {found.shape[1]} for a view of {size_px[0]} x {size_px[1]}"
        likely = f"output_stride is not {contract.output_stride}, or the layout is another"
        raise SegmenterError(text, where=contract.name, likely=likely, advice="correct output_stride in the contract")
    return found


def _without_batch(contract: NetworkContract, output: AnyArray, axes: int) -> AnyArray:
    """Return the output without its batch axis (and, of class maps, without a channel axis of one)."""
    found = output[0] if output.ndim == axes + 1 and output.shape[0] == 1 else output
    if contract.output == "argmax" and output.ndim == 4 and 1 in (output.shape[1], output.shape[3]):
        found = output[0, 0] if output.shape[1] == 1 else output[0, ..., 0]
    if found.ndim != axes:
        text = f"an output of shape {list(output.shape)} for {contract.output}"
        advice = "correct output: logits are [1, C, h, w], argmax is [1, h, w], queries are [Q, C + 1] and [Q, h, w]"
        raise SegmenterError(text, where=contract.name, advice=advice)
    if not np.isfinite(found).all():
        raise SegmenterError("the network gives NaN or Inf", where=contract.name, likely="its weights are damaged")
    return found


def _of_scores(contract: NetworkContract, scores: AnyArray) -> Floats:
    channels = len(contract.names) + contract.first_label
    last = contract.layout == "NHWC"
    if scores.shape[2 if last else 0] != channels:
        raise _wrong_classes(contract, int(scores.shape[2 if last else 0]))
    flat = np.asarray(scores if last else scores.transpose(1, 2, 0), dtype=np.float32)
    if contract.output == "logits":
        flat = np.exp(flat - flat.max(axis=2, keepdims=True))
    elif flat.min() < -1e-3:
        raise SegmenterError("probabilities below 0", where=contract.name, likely="these are logits")
    found = np.maximum(flat[..., contract.first_label :], 0.0) @ contract.matrix
    # "other" may be anything.
    found += np.maximum(flat[..., : contract.first_label].sum(axis=2, keepdims=True), 0.0) * np.float32(UNKNOWN)
    return _normalised(found)


def _of_labels(contract: NetworkContract, labels: AnyArray) -> Floats:
    numbers = labels.astype(np.int64)
    if not np.array_equal(numbers, labels):
        raise SegmenterError("class numbers that are not whole", where=contract.name, likely="these are scores")
    ignored = numbers == IGNORED_LABEL if len(contract.names) + contract.first_label <= IGNORED_LABEL else False
    numbers = np.where(ignored, -1, numbers - contract.first_label)
    least, most = int(numbers.min()), int(numbers.max())
    if most >= len(contract.names) or least < -1:
        number = (most if most >= len(contract.names) else least) + contract.first_label
        text = f"class number {number} of {len(contract.names)} classes that start at {contract.first_label}"
        likely = "labels are off by one (0 is 'other'), or names are missing"
        raise SegmenterError(text, where=contract.name, likely=likely, advice="set first_label, or list all names")
    # One row more, the last, for what no class is given to: number -1.
    rows = np.vstack([contract.matrix, np.full((1, len(SceneClass)), UNKNOWN, np.float32)])
    return np.asarray(rows[numbers], dtype=np.float32)


def _of_queries(contract: NetworkContract, classes: AnyArray, masks: AnyArray) -> Floats:
    names = len(contract.names) + contract.first_label
    if classes.shape[1] != names + 1:
        raise _wrong_classes(contract, int(classes.shape[1]), besides=1)
    if classes.shape[0] != masks.shape[0]:
        text = f"{classes.shape[0]} queries with {masks.shape[0]} masks"
        likely = "the two outputs are named in the wrong order"
        advice = "outputs: class logits first, mask logits second"
        raise SegmenterError(text, where=contract.name, likely=likely, advice=advice)
    scores = np.exp(classes - classes.max(axis=1, keepdims=True)).astype(np.float32)
    scores /= scores.sum(axis=1, keepdims=True)
    ours = scores[:, contract.first_label : names] @ contract.matrix
    shown = 1 / (1 + np.exp(-np.clip(masks.astype(np.float32), -60, 60)))
    return _normalised(np.einsum("qk,qhw->hwk", ours, shown, optimize=True))


def _normalised(found: Floats) -> Floats:
    total = found.sum(axis=2, keepdims=True)
    return np.where(total > 1e-6, found / np.maximum(total, 1e-6), np.float32(UNKNOWN)).astype(np.float32)


def _wrong_classes(contract: NetworkContract, found: int, besides: int = 0) -> SegmenterError:
    named = len(contract.names) + contract.first_label
    more = f" and {besides} more" if besides else ""
    text = f"the network gives {found} classes, the contract names {named}{more}"
    likely = "the names belong to another data set, or the layout differs"
    if found == named + besides + 1:
        likely = "one more is a background or 'other' class (labels not reduced): all would be off by one"
    advice = "set first_label to 1 where 0 is 'other', or list all names in index order"
    return SegmenterError(text, where=contract.name, likely=likely, advice=advice)
