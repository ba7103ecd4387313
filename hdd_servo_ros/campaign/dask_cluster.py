"""Campaign runs on a Dask cluster, an existing one or a local one."""

import concurrent.futures
import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from hdd_servo_ros.campaign.all_cores import ATTEMPTS, cores
from hdd_servo_ros.messages.errors import MissingExtra
from hdd_servo_ros.parameters.files import ArgumentError

_PATIENCE = 10.0
"""Time limit of the connection to a scheduler [s]."""


class _DaskExecutor(concurrent.futures.Executor):
    """Dask's executor with the arguments of ``shutdown`` that Python's executors have."""

    def __init__(self, client: Any) -> None:
        # Not pure: two runs with the same parameters are two rows.
        self._executor = client.get_executor(pure=False)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> 'concurrent.futures.Future[Any]':
        future: concurrent.futures.Future[Any] = self._executor.submit(fn, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._executor.shutdown(wait=wait)


@contextlib.contextmanager
def dask_executor(
    address: str | None = None, workers: int | None = None
) -> Iterator[tuple[Callable[[int], concurrent.futures.Executor], int]]:
    """
    Connect to a Dask cluster.

    Dask repeats the runs of a killed worker on another one.

    Parameters
    ----------
    address
        Address of its scheduler, such as ``tcp://host:8786``; None for a local cluster that ends with the block.
    workers
        Processes of a local cluster; None for one per core.

    Yields
    ------
    executor, workers
        Arguments of :meth:`~hdd_servo_ros.campaign.campaign.Campaign.run`.

    Raises
    ------
    MissingExtra
        If Dask is not installed.
    ArgumentError
        If no scheduler responds at the address, or it has no worker.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise MissingExtra('a Dask cluster', 'distributed') from None
    # Dask is typed in part only.
    make_client: Any = Client
    make_cluster: Any = LocalCluster
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set({'distributed.scheduler.allowed-failures': ATTEMPTS - 1}))
        if address is None:
            cluster = make_cluster(
                n_workers=workers or cores(), threads_per_worker=1, processes=True, dashboard_address=None
            )
            client = stack.enter_context(make_client(stack.enter_context(cluster)))
        else:
            try:
                client = stack.enter_context(make_client(address, timeout=_PATIENCE))
            except (OSError, ValueError) as error:
                raise ArgumentError(f'--scheduler {address}: no Dask scheduler responds there: {error}') from None
        threads = sum(client.nthreads().values())
        if not threads:
            raise ArgumentError(f'--scheduler {address}: the scheduler has no worker')
        yield lambda _: _DaskExecutor(client), threads
