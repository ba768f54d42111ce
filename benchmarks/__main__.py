"""``python -m benchmarks NAME [--quick] [--json] [--seed N]``; NAME may be ``all``.

With ``--json`` the last line of standard output is one JSON object a benchmark: name, metrics, rivals, units, notes,
seconds, machine, versions, seed, quick. Exit status 0 whatever the figures; 1 where a benchmark could not run (``all``
runs the others first).
"""

from __future__ import annotations

import json
import sys
import time
import traceback

import click

from benchmarks.form import Result, names, run_one


@click.command()
@click.argument("name")
@click.option("--quick", is_flag=True, help="Within 50 s on 2 cores, the same keys.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on the last line.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
def main(name: str, *, quick: bool, as_json: bool, seed: int) -> None:
    """Run benchmark NAME, or all."""
    known = names()
    chosen = known if name == "all" else [name]
    if name not in (*known, "all"):
        raise click.UsageError(f"no benchmark {name}; there are: {', '.join(known)}, all")
    failed, start_s = [], time.perf_counter()
    for one in chosen:
        try:
            result = run_one(one, quick=quick, seed=seed)
        except Exception as error:  # noqa: BLE001 (whatever it is, the others still run)
            traceback.print_exc()
            click.echo(f"{one} could not run: {type(error).__name__}: {error}", err=True)
            failed.append(one)
            continue
        click.echo(json.dumps(result) if as_json else _text(result))
        sys.stdout.flush()
    if name == "all":
        click.echo(f"{len(chosen) - len(failed)} of {len(chosen)} in {time.perf_counter() - start_s:.0f} s", err=True)
    if failed:
        click.echo(f"could not run: {', '.join(failed)}", err=True)
        sys.exit(1)


def _text(result: Result) -> str:
    lines = [f"{result['name']} ({result['seconds']} s, seed {result['seed']}{', quick' if result['quick'] else ''})"]
    units = result["units"]
    lines += [f"  metric  {key:<32} {value} {units.get(key, '')}".rstrip() for key, value in result["metrics"].items()]
    for rival, figures in result["rivals"].items():
        lines += [f"  rival   {rival + '.' + key:<32} {value}" for key, value in figures.items()]
    return "\n".join([*lines, *(f"  note    {note}" for note in result["notes"])])


if __name__ == "__main__":
    main()
