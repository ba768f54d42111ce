"""`python -m training generate|fit|export|evaluate ...`: see docs/reference/network.md."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click
import cv2

from benchmarks.seeds import Split


@click.group()
def main() -> None:
    """Make the room network: pictures, training, export, figures."""
    cv2.setNumThreads(1)


@main.command()
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the views.")
@click.option("--split", type=click.Choice(["train", "validation"]), default="train")
@click.option("--first", type=int, default=0, help="First batch; batch n begins at seed 20 n of the split.")
@click.option("--batches", type=int, default=1)
@click.option("--minutes", type=float, default=600.0, help="Begin no further batch after this time.")
@click.option("--waiting", type=int, default=1_000_000, help="Wait while so many files are there: `fit` deletes them.")
@click.option("--workers", type=int, default=1, help="Processes that draw side by side.")
@click.option("--furniture", type=click.Path(path_type=Path, exists=True), multiple=True, help="Folder of model files.")
def generate(out: Path, split: str, first: int, batches: int, workers: int, **rest: Any) -> None:
    """Draw batches of views (about 85 each) that are not there yet."""
    from multiprocessing import get_context

    from training.recipe import draw_batches
    from training.rooms.paints import bank_of

    out.mkdir(parents=True, exist_ok=True)
    bank_of(out)
    jobs = [
        partial(draw_batches, out, split, range(first + k, first + batches, workers), **rest) for k in range(workers)
    ]
    drawing = [get_context("spawn").Process(target=job) for job in jobs]
    for one in drawing:
        one.start()
    for one in drawing:
        one.join()
        if one.exitcode:
            raise click.ClickException("a worker failed: its error is above")


@main.command()
@click.option("--views", type=click.Path(path_type=Path), required=True)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="The checkpoint.")
@click.option("--steps", type=int, default=100_000)
@click.option("--minutes", type=float, default=None, help="End the schedule after this time at the latest.")
@click.option("--batch", type=int, default=112, help="Pictures a step.")
@click.option("--rate", type=float, default=1.6e-3, help="Highest learning rate.")
@click.option("--start", type=click.Path(path_type=Path), default=None, help="A checkpoint to go on from.")
@click.option("--delete", is_flag=True, help="Delete the files of views that were taken in.")
def fit(views: Path, out: Path, start: Path | None, *, delete: bool, **plan: Any) -> None:
    """Train on the views of a folder, on a GPU if there is one; files that come while it runs are used too."""
    from training.fit import Plan
    from training.fit import fit as run
    from training.rooms.paints import bank_of

    run(views, out, bank_of(views), Plan(**plan), start, delete=delete)


@main.command()
@click.option("--checkpoint", type=click.Path(path_type=Path), required=True)
@click.option("--validation", type=click.Path(path_type=Path), required=True, help="Views that calibrate sigma.")
@click.option("--rooms", type=int, default=24, help="Fully lit validation rooms that calibrate it too.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="The .onnx; a .json is written beside it.")
@click.option("--name", required=True, help="Name and version that results carry.")
def export(checkpoint: Path, validation: Path, rooms: int, out: Path, name: str) -> None:
    """Write the network as the program ships it; its sigmas hold on either kind of validation picture."""
    from training.export import export as run
    from training.judge import on_rooms, on_validation
    from training.rooms.paints import bank_of

    run(checkpoint, out, name=name, sigma_scale=(1.0, 1.0))
    cheap = on_validation(out, validation, bank_of(validation), every=2).scales()
    full = on_rooms(out, "validation", rooms).scales()
    scales = max(cheap[0], full[0]), max(cheap[1], full[1])
    run(checkpoint, out, name=name, sigma_scale=scales)
    click.echo(f"{out}: sigma scales {cheap} on training-like pictures, {full} on fully lit rooms")


@main.command()
@click.argument("networks", type=click.Path(path_type=Path, exists=True), nargs=-1, required=True)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="The .onnx; a .json is written beside it.")
@click.option("--name", required=True, help="Name and version that results carry.")
def join(networks: tuple[Path, ...], out: Path, name: str) -> None:
    """Write one network that answers with the mean of several exported ones, the finest first."""
    from training.join import join as run

    run(networks, out, name=name)


@main.command()
@click.option("--model", type=click.Path(path_type=Path), default=None, help="None: the shipped one.")
@click.option("--validation", type=click.Path(path_type=Path), default=None)
@click.option("--shared", type=click.Path(path_type=Path), default=None, help="The shared data folder.")
@click.option("--rooms", type=int, default=0, help="Of so many fully lit rooms, those in the cache of truths.")
@click.option("--split", type=click.Choice(["validation", "test"]), default="validation", help="Of --rooms.")
@click.option("--quality", default="standard")
@click.option("--scored-half", is_flag=True, help="The real pictures that nobody looks at.")
def evaluate(
    model: Path | None,
    validation: Path | None,
    shared: Path | None,
    rooms: int,
    split: Split,
    quality: str,
    scored_half: bool,
) -> None:
    """Print figures as JSON."""
    import json

    from processing.segmentation.embedded import SHIPPED
    from training.judge import on_real, on_rooms, on_validation
    from training.rooms.paints import bank_of

    chosen = model or SHIPPED
    said: dict[str, object] = {}
    if validation is not None:
        tally = on_validation(chosen, validation, bank_of(validation), quality=quality)
        said["validation"] = tally.rounded()
        said["reliability_deg"] = [(round(a, 2), round(b, 2)) for a, b in tally.reliability()]
    for name, empty in (("furnished", False), ("emptied", True)) if rooms else ():
        tally = on_rooms(chosen, split, rooms, quality=quality, empty=empty)
        said[f"{split} {name}"] = {"rooms": len(tally.floor_iou), **tally.rounded()}
    if shared is not None:
        said["real"] = on_real(chosen, shared, quality=quality, scored_half=scored_half)
    click.echo(json.dumps(said, indent=1))


if __name__ == "__main__":
    main()
