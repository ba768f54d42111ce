"""Grids of one bit a cell, for floods: rows of 64-bit words (rows, words), lowest bit first. Compiled (numba).

A row is flooded a word at a time, by doubling steps, so that a whole room takes microseconds.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

WORD = 64
_ZERO, _ONE, _ALL = np.uint64(0), np.uint64(1), np.uint64(0xFFFFFFFFFFFFFFFF)
_TOP = np.uint64(63)


def packed(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint64]:
    """Return a grid (rows, columns) as words; what is past the last column is set (blocked)."""
    rows, columns = cells.shape
    words = -(-columns // WORD)
    whole = np.ones((rows, words * WORD), dtype=np.bool_)
    whole[:, :columns] = cells
    told = np.packbits(whole, axis=1, bitorder="little").reshape(rows, words, 8).astype(np.uint64)
    return np.asarray((told << (8 * np.arange(8, dtype=np.uint64))).sum(axis=2, dtype=np.uint64))


@njit(cache=True)
def between(first, last, word):  # type: ignore[no-untyped-def]
    """Return the bits of columns first..last (inclusive) that lie in a word."""
    low, high = max(first - WORD * word, 0), min(last - WORD * word, WORD - 1)
    if low > high:
        return _ZERO
    return (_ALL >> np.uint64(WORD - 1 - (high - low))) << np.uint64(low)


@njit(cache=True)
def upwards(seeds, free):  # type: ignore[no-untyped-def]
    """Return the free bits that seeds (free bits too) reach towards higher columns."""
    for step in (1, 2, 4, 8, 16, 32):
        seeds |= free & (seeds << np.uint64(step))
        free &= free << np.uint64(step)
    return seeds


@njit(cache=True)
def downwards(seeds, free):  # type: ignore[no-untyped-def]
    """Return the free bits that seeds reach towards lower columns."""
    for step in (1, 2, 4, 8, 16, 32):
        seeds |= free & (seeds >> np.uint64(step))
        free &= free >> np.uint64(step)
    return seeds


@njit(cache=True)
def fill_row(reached, free):  # type: ignore[no-untyped-def]
    """Let what is reached of a row (words,) spread along its free runs."""
    words = reached.size
    carry = _ZERO
    for w in range(words):
        seeds = reached[w] | (carry & free[w])
        reached[w] = upwards(seeds, free[w]) if seeds != _ZERO else _ZERO
        carry = reached[w] >> _TOP
    carry = _ZERO
    for w in range(words - 1, -1, -1):
        seeds = reached[w] | ((carry << _TOP) & free[w])
        reached[w] = downwards(seeds, free[w]) if seeds != _ZERO else _ZERO
        carry = reached[w] & _ONE


@njit(cache=True)
def take_from(reached, free, i, j):  # type: ignore[no-untyped-def]
    """Let row j's reached cells spread to row i; tell whether any is new."""
    new = False
    for w in range(reached.shape[1]):
        fresh = reached[j, w] & free[i, w] & ~reached[i, w]
        if fresh != _ZERO:
            reached[i, w] |= fresh
            new = True
    if new:
        fill_row(reached[i], free[i])
    return new


@njit(cache=True)
def spread(reached, free, row):  # type: ignore[no-untyped-def]
    """Let what is reached in one row spread over four neighbours through the free cells (rows, words)."""
    rows = free.shape[0]
    fill_row(reached[row], free[row])
    low, high = row, row
    changed = True
    while changed:
        changed = False
        for i in range(max(1, low), rows):
            if take_from(reached, free, i, i - 1):
                changed, high = True, max(high, i)
            elif i > high:
                break
        for i in range(min(rows - 2, high), -1, -1):
            if take_from(reached, free, i, i + 1):
                changed, low = True, min(low, i)
            elif i < low:
                break


@njit(cache=True)
def count_bits(word):  # type: ignore[no-untyped-def]
    """Return how many bits of a word are set."""
    count = 0
    while word != _ZERO:
        word &= word - _ONE
        count += 1
    return count


@njit(cache=True)
def lowest(word):  # type: ignore[no-untyped-def]
    """Return a word's lowest set bit alone."""
    return word & (~word + _ONE)
