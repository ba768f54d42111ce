"""What is made of equal frames is made once; imports share the processes that check frames."""

from pathlib import Path

import pytest

from tests.frame_workers import kept_workers
from tests.once import each_pure_once

__all__ = ["each_pure_once", "kept_workers"]


@pytest.fixture(scope="package")
def raw_rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sessions of one rig, with raw files."""
    from tests.processing.commands.rigs import write_rig

    return write_rig(tmp_path_factory.mktemp("raw-rig"))
