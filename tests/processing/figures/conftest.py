"""How wide the cells of equal pictures are is worked out once (`tests.once`)."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.once import PURE, each_once


@pytest.fixture(scope="package", autouse=True)
def _each_once() -> Iterator[None]:
    with each_once(PURE):
        yield
