"""What stands in for pure functions in other tests gives what they would, as copies, and anew where that is asked."""

from __future__ import annotations

import pytest

from processing.errors import ResponseError
from tests.once import all_anew, once


def test_equal_arguments_are_worked_out_once_and_each_gets_its_own() -> None:
    asked: list[int] = []

    @once
    def listed(number: int) -> list[int]:
        asked.append(number)
        return [number]

    first, again, other = listed(1), listed(1), listed(2)
    assert (first, again, other) == ([1], [1], [2])
    assert asked == [1, 2]
    first.append(7)
    assert listed(1) == [1]
    with all_anew():
        assert listed(1) == [1]
    assert asked == [1, 2, 1]


def test_a_refusal_is_kept_too_and_what_a_caller_adds_to_it_is_not() -> None:
    asked: list[int] = []

    @once
    def refused(number: int) -> int:
        asked.append(number)
        raise ResponseError("no curve", where="here", advice="another")

    for _ in range(3):
        with pytest.raises(ResponseError) as caught:
            refused(1)
        assert (caught.value.where, caught.value.advice) == ("here", "another")
        caught.value.where = "of the caller"
    assert asked == [1]
