"""``daylit rig``: what belongs to the instruments rather than to a room; ``daylit rig calibrate``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import answer, numbers, parameters

if TYPE_CHECKING:
    from processing.calibration.profile import RigProfile
    from processing.calibration.response.shutter import ShutterRule
    from processing.rig.calibrate import RigRequest, RigResult
    from station.session.session import Side


@click.group()
def rig() -> None:
    """Calibrate the instruments of a rig."""


@rig.command(params=parameters(__package__, "rig calibrate"))
def calibrate(out: Path, *, as_json: bool, **options: Any) -> int:
    """Find the rig's response curves, noise, lens data and k2 from SESSIONS; write a profile for `daylit process`.

    The first of SESSIONS (or --chart) shows a 24-patch colour chart to both cameras in a closed room under constant
    light. Further SESSIONS only refine the response curves: choose high-contrast scenes. Pictures beside the profile
    show where the chart was found: check them.

    \b
    Examples:
      daylit rig calibrate rig/chart rig/room --lens-data theta_z1
      daylit rig calibrate rig/chart rig/room --flat rig/sphere --nd rig/chart rig/chart-no-nd --into lab.json
      daylit rig calibrate rig/chart rig/room --lamp rig/lamp rig/lamp-hidden --lamp rig/lamp2 rig/lamp2-hidden
      daylit rig calibrate rig/chart --corners outdoor:812,604,1003,610,999,742,809,733
    """
    from drivers.clock import SystemClock
    from processing.calibration.profile import save_profile
    from processing.rig.calibrate import calibrate_rig
    from station.errors import UsageError

    if not out.absolute().parent.is_dir():
        raise UsageError("no such folder", where=f"--into {out}", advice="create it first")
    progress = (lambda _text: None) if as_json else (lambda text: click.echo(text, err=True))
    result = calibrate_rig(_request(options), SystemClock().utc_now(), progress)
    save_profile(out, result.profile)
    pictures = _save_pictures(out, result)
    facts = {"ok": True, "profile": str(out), "pictures": pictures, **_summary(result)}
    return answer(facts, [*_lines(result), f"wrote {out}; check {', '.join(pictures)}"], as_json=as_json)


def _request(options: dict[str, Any]) -> RigRequest:
    from processing.calibration.response.shutter import ShutterRule
    from processing.rig.calibrate import RigRequest

    first, *rest = options["sessions"]
    chart = options["chart"] or first
    others = (first, *rest) if options["chart"] else tuple(rest)
    sided = map(_sided, options["corners"])
    corners = {side: numbers("--corners", text, 8, "X,Y of four corners") for side, text in sided}
    rules = {side: _rule(text, tuple(ShutterRule)) for side, text in map(_sided, options["shutter"])}
    half_rad, nd = math.radians(options["half_field"]), options["nd"] or None
    given = {name: options[name] for name in ("flats", "turned", "lamps", "lens_data")}
    return RigRequest(
        chart=chart, sessions=others, nd=nd, corners=corners, rules=rules, half_field_rad=half_rad, **given
    )


def _sided(text: str) -> tuple[Side, str]:
    """Return the side and the rest of SIDE:REST."""
    from processing.errors import ParameterError
    from station.session.session import Side

    name, colon, rest = text.partition(":")
    if not colon or name not in tuple(Side):
        raise ParameterError(f"{text!r} does not name a camera", advice="write indoor:... or outdoor:...")
    return Side(name), rest


def _rule(text: str, rules: tuple[ShutterRule, ...]) -> ShutterRule:
    from processing.errors import ParameterError

    found = next((rule for rule in rules if rule.value == text), None)
    if found is None:
        raise ParameterError(f"no such rule: {text!r}", where="--shutter", advice=f"one of {', '.join(rules)}")
    return found


def _save_pictures(out: Path, result: RigResult) -> list[str]:
    from processing.rig.calibrate import chart_png
    from station.session.folder import Folder, write_file

    names = []
    with Folder.open(out.parent) as folder:
        for side, view in result.views.items():
            name = f"{out.stem}-chart-{side}.png"
            write_file(folder, name, chart_png(view))
            names.append(str(out.parent / name))
    return names


def _summary(result: RigResult) -> dict[str, Any]:
    from processing.calibration.response.curve import fit_text

    profile: RigProfile = result.profile
    cameras = {}
    for side, camera in profile.cameras.items():
        response = camera.response
        cameras[str(side)] = {
            "shutter": str(camera.shutter.rule),
            "response_residual_stops": response.residual_stops if response else None,
            "response_fit": fit_text(response.model_dump()) if response else "",
            "vignetting": camera.vignetting.source if camera.vignetting else None,
            "lens": camera.lens.source if camera.lens else None,
            "nd_density": camera.nd.density if camera.nd else None,
            "colour": camera.nd.source if camera.nd else None,
            "glare_index": camera.glare.index if camera.glare else None,
            "chart_mismatch": result.views[side].chart.mismatch,
            "chart_found_by": result.views[side].chart.how,
        }
    k2 = profile.k2.model_dump(mode="json", exclude={"patches", "indoor", "outdoor"}) if profile.k2 else None
    raw = {"frames": profile.raw.frames, "k2": profile.raw.k2 and profile.raw.k2.value} if profile.raw else None
    return {"cameras": cameras, "k2": k2, "raw": raw, "warnings": list(profile.warnings)}


def _lines(result: RigResult) -> list[str]:
    found = _summary(result)
    lines = []
    for side, facts in found["cameras"].items():
        lines.append(
            f"{side}: response to {facts['response_residual_stops']:.4f} stop, shutter times {facts['shutter']}, "
            f"chart by {facts['chart_found_by']} (colours differ by {facts['chart_mismatch']:.1%})"
        )
        named = {"curve": "response_fit", "vignetting": "vignetting", "lens": "lens", "colour": "colour"}
        lines += [f"  {name}: {facts[key]}" for name, key in named.items() if facts[key]]
        lines += [f"  stray light: {facts['glare_index']:.2%} of the mean"] if facts["glare_index"] is not None else []
        lines += [f"  ND filter: density {facts['nd_density']:.3f}"] if facts["nd_density"] else []
    k2 = result.profile.k2
    if k2 is not None:
        lines.append(
            f"k2 = {k2.value:.5g} +- {k2.relative_uncertainty:.1%} from {k2.n_patches} neutral patches "
            f"(they scatter by {k2.residual_stops:.4f} stop); the white patch alone: {k2.white_ratio:.5g}"
        )
        worst = max((p for p in k2.patches), key=lambda p: p.color_difference)
        lines.append(f"colours of both cameras differ by up to {worst.color_difference:.1f} (L*a*b*, {worst.name})")
    if raw := found["raw"]:
        kinds = ", ".join(f"{side} {kind}" for side, kind in raw["frames"].items())
        lines.append(f"with raw files ({kinds}): " + (f"k2 = {raw['k2']:.5g}" if raw["k2"] else "no k2"))
    return [*lines, *(f"warning: {text}" for text in found["warnings"])]
