"""The workers of a dask cluster as an executor. Nothing else imports dask."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from simulator.results.extras import MissingExtra

PATIENCE = 10.0  # seconds to wait for a scheduler

__all__ = ["MissingExtra", "connected"]


@contextmanager
def connected(address: str) -> Iterator[tuple[Executor, int]]:
    """An executor on a running cluster, and the number of its threads (at least one).

    Parameters
    ----------
    address : str
        Of the scheduler, such as `tcp://10.0.0.1:8786`.

    Raises
    ------
    MissingExtra
        If dask is not installed.
    ConnectionError
        If no scheduler answers there.
    """
    try:
        import distributed
    except ImportError as error:
        raise MissingExtra("--dask needs dask: pip install 'dielectric-balloons[dask]'") from error
    try:
        # Any: it comes without types.
        make: Any = distributed.Client
        client = make(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError, ImportError) as error:
        reason = str(error).strip() or type(error).__name__
        raise ConnectionError(
            f"--dask {address}: no scheduler answers there ({reason}); must be the address that "
            "`dask scheduler` prints, such as tcp://10.0.0.1:8786"
        ) from error
    with client:
        yield client.get_executor(pure=False), max(1, sum(client.ncores().values()))
