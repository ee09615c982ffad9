"""Work spread over the workers of a Dask cluster; one that dies costs time only."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Any
from uuid import uuid4

from ...config import ConfigError
from .cases import Case
from .work import Outcome, Task, done

LOCAL = "local"
CONNECT_S = 10.0
MOST_DEATHS = 3
"""Workers that may die of one case before it is given up."""
_ENVIRONMENT = {f"{name}_NUM_THREADS": 1 for name in ("OMP", "MKL", "OPENBLAS")}
"""Of local workers: Dask's own, but for giving each array back to the system when it is done with,
which takes a third of a worker's time."""


def serial(task: Task, cases: Sequence[Case]) -> Iterator[Outcome]:
    """Outcomes of all cases, one after the other, in this process."""
    return (done(task, case) for case in cases)


def on_cluster(
    task: Task, cases: Sequence[Case], address: str, workers: int | None = None
) -> Iterator[Outcome]:
    """Outcomes of all cases, as they come.

    Args:
        address: "local" for processes of this computer, or tcp://HOST:PORT, tls://HOST:PORT of a
            scheduler, whose workers see the same files; TLS as in Dask's own configuration.
        workers: processes of a local cluster; one a core by default.

    Raises:
        ConfigError: no such cluster, or one of another version.
    """
    distributed = _library()
    with ExitStack() as stack:
        client = _client(distributed, address, workers, stack)
        futures = {client.submit(done, task, case, key=_own_key(case)): case for case in cases}
        for future in distributed.as_completed(futures):
            yield _outcome(future, futures[future])
            future.release()


def _own_key(case: Case) -> str:
    """Key of one task for ever: a scheduler gives everybody who asks for a known key its result."""
    return f"{case.name}-{uuid4().hex}"


def _outcome(future: Any, case: Case) -> Outcome:
    """The result; a case that ends its workers, or breaks in them, has none."""
    from ... import exit_status

    error = future.exception()
    if error is None:
        outcome: Outcome = future.result()
        return outcome
    words = f"{case.name}: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
    return Outcome(case, exit_status.INTERNAL_FAILURE, words)


def _library() -> Any:
    try:
        import dask
        import distributed
    except ImportError as error:
        raise ConfigError(
            f"--cluster: needs `pip install edge-service[cluster]` ({error})"
        ) from None
    dask.config.set({"distributed.scheduler.allowed-failures": MOST_DEATHS})
    dask.config.set({"distributed.nanny.pre-spawn-environ": _ENVIRONMENT})
    return distributed


def _client(distributed: Any, address: str, workers: int | None, stack: ExitStack) -> Any:
    if address == LOCAL:
        cluster = distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            silence_logs="CRITICAL",
        )
        return stack.enter_context(distributed.Client(stack.enter_context(cluster)))
    if not address.startswith(("tcp://", "tls://")):
        raise ConfigError(
            f"--cluster {address}: expected local, tcp://HOST:PORT or tls://HOST:PORT"
        )
    try:
        client = stack.enter_context(distributed.Client(address, timeout=CONNECT_S))
    except (TimeoutError, OSError, ValueError, TypeError) as error:
        raise ConfigError(f"--cluster {address}: no scheduler answers there ({error})") from None
    _check_versions(client, address)
    return client


def _check_versions(client: Any, address: str) -> None:
    """Raises ConfigError for workers that would answer otherwise than this program."""
    there = client.run(installed_version)
    if not there:
        raise ConfigError(f"--cluster {address}: it has no workers")
    for worker, version in there.items():
        if version != installed_version():
            raise ConfigError(
                f"--cluster {address}: worker {worker} has version {version}, "
                f"expected {installed_version()}"
            )


def installed_version() -> str:
    """Version of the program where this runs."""
    from importlib.metadata import version

    return version("edge-service")
