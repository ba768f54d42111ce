"""Batch by URL against a store that fails: no half session is ever called done."""

from __future__ import annotations

import os
import time

import pytest

from tests.torture import faulty_store, ledger

LONG = os.environ.get("DAYLIT_TORTURE") == "1"
SEED = 18


@pytest.mark.torture
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the store's server
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_no_half_session_is_called_done() -> None:
    begun_s = time.monotonic()
    with faulty_store.object_store() if LONG else faulty_store.in_memory() as files:
        injected, result, wrong = faulty_store.campaign(files, 2000 if LONG else 25, SEED)
    ledger.record(
        "object store: lost, late and half operations, workers killed",
        injected=injected,
        observed=result,
        lost=len(wrong),
        seconds=time.monotonic() - begun_s,
        seed=SEED,
        notes="batch by URL; observed: runs that ended without being done",
    )
    assert injected >= (2000 if LONG else 25)
    assert result > 0, "some faults must be seen"
    assert wrong == []
