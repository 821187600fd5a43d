"""The same work on a Dask scheduler that the user runs."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from fmopt.errors import ResourceError

_PATIENCE = "20s"


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """An executor of a Dask scheduler, and how many batches its workers do at a time.

    Args:
        address: of the scheduler, such as `tcp://10.0.0.5:8786`.

    Raises:
        ResourceError: Dask is not installed, no scheduler answers, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ResourceError("--cluster needs Dask", "install fmopt with its extra 'cluster'") from error
    try:
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        advice = "start dask scheduler and dask worker, or correct the address"
        raise ResourceError(f"{address}: no scheduler answers ({error})", advice) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError as error:
            raise ResourceError(f"{address}: the scheduler has no workers", f"start dask worker {address}") from error
        yield client.get_executor(), sum(client.nthreads().values())
