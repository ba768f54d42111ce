"""``daylit models``: networks of others that daylit can use: what there is, fetched on request, or added by hand."""

from pathlib import Path

import click

from station.commands.views import answer, parameters


@click.group()
def models() -> None:
    """List, download or add third-party networks; daylit uses them once they are installed.

    Only `get` downloads anything. Models are kept in the user's data folder, or in DAYLIT_MODELS.

    \b
    Examples:
      daylit models list
      daylit models get ade20k-deeplab
      daylit models add Downloads/deeplabv3_mnv2_ade20k_uint8.tflite
    """


@models.command("list", params=parameters(__package__, "models list"))
def list_(*, as_json: bool) -> int:
    """List the models with size, licence, SHA-256, source, and whether they are installed.

    \b
    Example:
      daylit models list --json
    """
    from processing.segmentation.installed import KNOWN_MODELS, installed

    rows = [
        {
            **{key: getattr(model, key) for key in ("name", "what", "file", "size_bytes", "sha256", "licence", "url")},
            "installed": str(there) if (there := installed(model)) else None,
        }
        for model in KNOWN_MODELS
    ]
    lines = []
    for row in rows:
        lines.append(f"{row['name']}  {'installed' if row['installed'] else 'not installed'}: {row['what']}")
        lines.append(f"    {row['file']}, {row['size_bytes'] / 1e6:.1f} MB, SHA-256 {row['sha256']}")
        lines += [f"    {row['licence']}", f"    {row['installed'] or row['url']}"]
    return answer({"ok": True, "models": rows}, lines, as_json=as_json)


@models.command(params=parameters(__package__, "models get"))
def get(name: str, url: str | None, *, as_json: bool) -> int:
    """Download model NAME, check its SHA-256 and install it; an installed model is not downloaded again.

    \b
    Example:
      daylit models get ade20k-deeplab
    """
    from processing.segmentation.installed import get_model, model_named

    model = model_named(name)
    return _done(model.name, get_model(model, url=url), as_json=as_json)


@models.command(params=parameters(__package__, "models add"))
def add(file: Path, *, as_json: bool) -> int:
    """Install a model FILE you downloaded yourself; its SHA-256 identifies the model.

    \b
    Example:
      daylit models add deeplabv3_mnv2_ade20k_uint8.tflite
    """
    from processing.segmentation.installed import add_model

    model, path = add_model(file)
    return _done(model.name, path, as_json=as_json)


def _done(name: str, path: Path, *, as_json: bool) -> int:
    lines = (f"{name}: {path}", "`daylit process` will use it from now on (--segmenter own: not)")
    return answer({"ok": True, "model": name, "file": str(path)}, lines, as_json=as_json)
