"""The stage verify: every frame is what the manifest says, or the run ends here with all problems named."""

from processing.stages.contract import StageContext, StageOutput, StageWarning
from station.session.verify import WORTH_NOTING, verify_session


def run(context: StageContext) -> StageOutput:
    """Check the session; raises `IntegrityError` listing every problem. What is missing is a warning."""
    report = verify_session(context.session_path)
    report.raise_for_problems()
    warnings = tuple(StageWarning(code="missing", message=what[:500]) for what in report.missing)
    warnings += tuple(
        StageWarning(code=w.code, message=w.message) for w in context.session.warnings if w.code in WORTH_NOTING
    )
    return StageOutput(
        metrics={"status": report.status, "frames": report.frames_checked, "bytes": report.bytes_read},
        warnings=warnings,
    )
