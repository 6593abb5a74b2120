# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many jobs on a Dask cluster that exists already.

Optional: needs `dask[distributed]` on every machine. The cluster owns scheduling and retries: a job whose worker dies
is done by another.
"""

import asyncio
import importlib
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from atpid_common.errors import InputError, extras

#: How long a scheduler may take to answer [s].
_CONNECT_TIMEOUT = 10.0
Job = TypeVar("Job")
Answer = TypeVar("Answer")


class ClusterError(InputError):
    """A cluster that cannot be used; one line."""


def on_cluster(
    address: str, work: Callable[[Job], Answer], jobs: Iterable[Job]
) -> Generator[tuple[Job, Answer], None, None]:
    """Yield (job, answer of `work`) as the workers of the scheduler at `address` deliver them.

    Work, jobs and answers are sent as pickles; functions of the project by name, so that workers need it installed.
    Raises ClusterError where dask is not installed, no scheduler answers, or every worker that tried a job has exited;
    what `work` raises is raised here. Jobs that wait when the caller ends are cancelled.
    """
    with extras("--cluster", ClusterError):
        distributed: Any = importlib.import_module("distributed")
    try:
        with ThreadPoolExecutor(1) as beside:  # where an event loop may run already, as in a notebook
            beside.submit(asyncio.run, _greeted(distributed, address)).result()
        client = distributed.Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, asyncio.TimeoutError) as error:
        raise ClusterError(
            f"--cluster: given {address}; no Dask scheduler answers there ({type(error).__name__}); "
            "start one with `dask scheduler`, or leave the option out"
        ) from None
    with client:
        given = list(jobs)
        futures = dict(zip(client.map(work, given, pure=False), given, strict=True))
        try:
            for future in distributed.as_completed(list(futures), loop=client.loop):
                try:
                    yield futures[future], future.result()
                except distributed.scheduler.KilledWorker:
                    lost = f"--cluster: every worker that computed {futures[future]} exited; see their logs"
                    raise ClusterError(lost) from None
        finally:
            client.cancel(list(futures))


async def _greeted(distributed: Any, address: str) -> None:
    """Wait for a scheduler's greeting: a client would wait for it for ever where something else listens."""
    greeted = await asyncio.wait_for(distributed.comm.connect(address, timeout=_CONNECT_TIMEOUT), _CONNECT_TIMEOUT)
    await greeted.close()
