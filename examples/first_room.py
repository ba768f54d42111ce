"""A first room, without instruments: simulated cameras photograph it, and the pictures are put on the meter's scale.

    python examples/first_room.py [FOLDER]

It writes a session into FOLDER (default: sessions) and prints what was measured; `daylit process` on the same session
then goes on from there: room, furniture, staged pictures, report.
"""

from __future__ import annotations

import sys

import daylit


def main(folder: str = "sessions") -> int:
    """Capture a small session of the built-in room, process it up to calibration, and print figures."""
    session = daylit.capture("first room", folder, simulate="room", size="small", rate=4)
    print(f"{session.path}: {len(session.manifest.frames)} frames, {session.manifest.status.value}")

    report = daylit.process(session, until="calibrate", quality="draft")
    for stage in report.stages:
        print(f"{stage.stage:<10} {stage.action:<10} {stage.reason}")

    picture = daylit.read_picture(session / "stages" / "calibrate" / "indoor.exr")
    assert isinstance(picture, daylit.LuminanceImage)
    luminance = picture.luminance_cd_m2()
    valid = luminance[picture.validity == daylit.Validity.VALID]
    print(f"luminance {valid.min():.3g} to {valid.max():.4g} {picture.unit}, mean {valid.mean():.4g}")
    print(f"common scale known to {100 * picture.scale_uncertainty:.2g} %")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
