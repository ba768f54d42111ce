"""What stages do with equal pictures is done once (`tests.once`)."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.once import PURE, all_anew, each_once


@pytest.fixture(scope="package", autouse=True)
def _each_once() -> Iterator[None]:
    with each_once(PURE):
        yield


@pytest.fixture
def anew() -> Iterator[None]:
    with all_anew():
        yield
