"""The same work on a Dask scheduler that the user runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from fmopt.errors import ResourceError

if TYPE_CHECKING:
    from distributed import Client

_PATIENCE = 20.0  # s: for a scheduler to answer
_COMING = 60.0  # s: for workers to come
_RETURN = 120.0  # s: for workers to come back after all were lost
_GLANCE = 1.0  # s between looks at whether there are workers


class Hosts(Executor):
    """The workers of a scheduler as an executor, which may go away for good."""

    def __init__(self, client: Client, address: str) -> None:
        self._client, self._executor, self._address = client, client.get_executor(), address
        self._seen = self._looked = time.monotonic()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hands a call to a worker.

        Raises:
            ResourceError: the scheduler is gone.
        """
        self._connected()
        future: Future[Any] = self._executor.submit(fn, *args, **kwargs)
        return future

    def _connected(self) -> None:
        if self._client.status in ("closing", "closed"):
            raise self._gone("the scheduler is gone")

    def _gone(self, words: str) -> ResourceError:
        advice = f"start it and dask worker {self._address}, then the study again: it goes on where it was"
        return ResourceError(f"{self._address}: {words}", advice)

    def watch(self) -> None:
        """Looks whether anybody is there, once a second.

        Raises:
            ResourceError: the scheduler is gone, or no worker has been there for a while.
        """
        self._connected()
        now = time.monotonic()
        # The scheduler answers over the network, and is watched with every beat of the desk.
        if now - self._looked < _GLANCE:
            return
        self._looked = now
        try:
            threads = self._client.nthreads()
        except OSError as error:
            raise self._gone(f"the scheduler is gone ({error})") from error
        if threads:
            self._seen = now
        elif now - self._seen > _RETURN:
            advice = f"start dask worker {self._address}, and the study again: it goes on where it was"
            raise ResourceError(f"{self._address}: the scheduler has lost all its workers", advice)


def _checked(address: str) -> None:
    """Refuses at once what is no address, by a ResourceError."""
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    try:
        known = parts.scheme in ("tcp", "tls", "ws", "wss", "ucx") and parts.hostname and parts.port
    except ValueError:  # a port that is no number
        known = False
    if not known:
        raise ResourceError(f"{address}: this is no address of a scheduler", "write one such as tcp://10.0.0.5:8786")


@contextmanager
def cluster(address: str) -> Iterator[tuple[Hosts, int]]:
    """An executor of a Dask scheduler, at such as `tcp://10.0.0.5:8786`, and how many batches its workers do at a time.

    Raises:
        ResourceError: Dask is not installed, no scheduler answers, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ResourceError("--cluster needs Dask", "install fmopt with its extra 'cluster'") from error
    _checked(address)
    try:
        # Who calls from a notebook keeps the default client that is there.
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        advice = "start dask scheduler and dask worker, or correct the address"
        raise ResourceError(f"{address}: no scheduler answers ({error})", advice) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_COMING)
        except TimeoutError as error:
            raise ResourceError(f"{address}: the scheduler has no workers", f"start dask worker {address}") from error
        yield Hosts(client, address), sum(client.nthreads().values())
