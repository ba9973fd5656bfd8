"""Executors that functions with the argument `executor` accept."""

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

import pytest

POOLS = {
    "threads": lambda: ThreadPoolExecutor(2),
    "processes": lambda: ProcessPoolExecutor(2, mp_context=get_context("spawn")),
}


@contextmanager
def executor_of(kind):
    """Yield two workers: threads, spawned processes, or those of a local cluster of Dask."""
    if kind in POOLS:
        with POOLS[kind]() as pool:
            yield pool
        return
    dask = pytest.importorskip("dask", reason="needs the extra dask")
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    names = ("comm.timeouts.connect", "comm.timeouts.tcp", "deploy.lost-worker-timeout")
    with (
        dask.config.set({f"distributed.{name}": "600s" for name in names}),  # on a busy machine
        # The default of the limit depends on the machine.
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit=0
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client.get_executor()
