"""The same work on a Dask scheduler that the user runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from fmopt.errors import ResourceError
from fmopt.study.running import Remote

if TYPE_CHECKING:
    from distributed import Client

_PATIENCE = 20.0  # s: for a scheduler to answer, and for workers to come
_RETURN = 120.0  # s: for workers to come back after all were lost
_GLANCE = 1.0  # s between looks at whether there are workers


class Hosts(Remote):
    """The workers of a scheduler as an executor.

    Args:
        client: of the scheduler.
        address: of the scheduler, for messages.
    """

    def __init__(self, client: Client, address: str) -> None:
        self._client, self._executor, self._address = client, client.get_executor(), address
        self._seen = self._looked = time.monotonic()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hands a call to a worker."""
        future: Future[Any] = self._executor.submit(fn, *args, **kwargs)
        return future

    def watch(self) -> None:
        """Looks whether anybody is there, once a second.

        Raises:
            ResourceError: no worker has been there for a while.
        """
        now = time.monotonic()
        if now - self._looked < _GLANCE:
            return
        self._looked = now
        if self._client.nthreads():
            self._seen = now
        elif now - self._seen > _RETURN:
            advice = f"start dask worker {self._address}, and the study again: it goes on where it was"
            raise ResourceError(f"{self._address}: the scheduler has lost all its workers", advice)


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
        yield Hosts(client, address), sum(client.nthreads().values())
