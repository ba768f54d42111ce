"""A Dask cluster: on this computer (loopback only), or one that is there already.

On a local cluster each worker is a process that does one session at a time. Whoever may connect to a Dask scheduler
may run code on its workers: therefore nothing listens beyond the loopback unless a cluster elsewhere was named.
"""

import gc
import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from processing.errors import ClusterError
from processing.ground.tables import table_of
from processing.ground.threads import SPINNING, cores_here

LOOPBACK = "127.0.0.1"
SESSION_BYTES = 5 << 30  # of memory that one full-size session may take
CONNECT_S = 30  # chosen: a busy scheduler answers within seconds
CLOSE_S = 30  # chosen: workers end within seconds


def usual_workers() -> int:
    """Return how many sessions this computer does at once: one for two cores, and no more than memory holds."""
    cores = os.cpu_count() or 1
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError):
        memory = SESSION_BYTES
    return max(1, min(cores // 2, memory // SESSION_BYTES))


def threads_each(sessions: int) -> int:
    """Return how many threads a session's libraries may use, so that all sessions together use every core once."""
    return max(1, cores_here() // max(1, sessions))


def threads_by_machine(client: Any) -> dict[str, int]:
    """Return how many threads (sessions at once) the workers of each machine have; {} where nobody answers."""
    found: dict[str, int] = {}
    try:
        for address, threads in client.nthreads().items():
            host = machine_of(address)
            found[host] = found.get(host, 0) + threads
    except Exception:  # noqa: BLE001 (whatever keeps it from answering, there is nobody to work)
        return {}
    return found


def machine_of(address: str) -> str:
    """Return the machine in a Dask address such as tcp://10.0.0.5:41234; workers without one are in this process."""
    return address.rpartition("://")[2].rpartition(":")[0]


def here_among(machines: Mapping[str, int]) -> int:
    """Return how many sessions share this worker's machine, 1 where it is not known."""
    import distributed

    try:
        worker: Any = distributed.get_worker()
    except ValueError:
        return 1
    return machines.get(machine_of(worker.address), 1)


def thread_settings(threads: int) -> dict[str, str]:
    """Return the environment by which numerical libraries take this many threads; those that spin one."""
    names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM", "DAYLIT_THREADS")
    return dict.fromkeys(names, str(threads)) | dict.fromkeys(SPINNING, "1")


@contextmanager
def connected(address: str | None, workers: int, scratch: Path) -> Iterator[Any]:
    """Give a Dask client of the cluster at ``address``, or of one made for the purpose on this computer.

    ``scratch``: where local workers keep their own small files. Raises `ClusterError` where there is no cluster.
    """
    # First of all: it brings its own settings, which would go with ours if ours were there before.
    import distributed

    # Dask's own log lines stay off the terminal: what becomes of sessions is reported by us.
    library = distributed.__name__
    for name in (library, *(f"{library}.{part}" for part in ("nanny", "scheduler", "worker")), "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    import dask

    with dask.config.set(table_of(__package__, "dask")):
        if address is not None:
            with _elsewhere(address) as client:
                yield client
        else:
            with put_away(_here(workers, scratch)) as cluster, _client(cluster) as client:
                yield client


@contextmanager
def put_away(cluster: Any) -> Iterator[Any]:
    """Give the cluster, and close it; nothing that goes wrong in closing it undoes the sessions that are done.

    A nanny that is beginning a dead worker anew cannot be closed at that moment (it fails an assertion of Dask's);
    workers are daemons, and go with this process in any case.
    """
    try:
        yield cluster
    finally:
        try:
            cluster.close(timeout=CLOSE_S)
        except Exception as error:  # noqa: BLE001 - whatever it is, the work is done and reported
            logging.getLogger(__name__).info("the cluster did not close as it should: %r", error)


def _client(cluster: Any) -> Any:
    import distributed

    dask_client: Any = distributed.Client
    return dask_client(cluster, timeout=CONNECT_S)


def _elsewhere(address: str) -> Any:
    try:
        return _client(address)
    except Exception as error:  # noqa: BLE001 (Dask refuses an address in many ways, assertions of its own among them)
        why = next(iter(str(error).splitlines()), "") or type(error).__name__
    # The half-made client closes itself when it is collected: now, and not while another one is being made, which
    # holds the lock that closing waits for.
    gc.collect()
    text = f"no Dask scheduler answers ({why})"
    raise ClusterError(text, where=address, advice="start `dask scheduler` and give the address it prints")


def _here(workers: int, scratch: Path) -> Any:
    import distributed

    local_cluster: Any = distributed.LocalCluster
    return local_cluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host=LOOPBACK,
        dashboard_address=f"{LOOPBACK}:0",
        worker_dashboard_address=f"{LOOPBACK}:0",
        memory_limit=0,
        local_directory=str(scratch),
        silence_logs=logging.CRITICAL,
    )
