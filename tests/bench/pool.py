"""Work of the benchmarks, spread over processes."""

import contextlib
import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

Progress = Callable[[str], None]
"""Takes a line that says how far it is."""
Result = TypeVar("Result")
_THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def in_processes(
    jobs: Sequence[Callable[[], Result]], processes: int
) -> Iterator[tuple[int, Result]]:
    """Number and result of each job, as they end, in processes of one thread each.

    Args:
        jobs: can be pickled.
    """
    context = multiprocessing.get_context("spawn")
    with _one_thread_each(), ProcessPoolExecutor(processes, context) as pool:
        started = {pool.submit(job): number for number, job in enumerate(jobs)}
        for done in as_completed(started):
            yield started[done], done.result()


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes begun meanwhile leave the other cores to each other."""
    before = {name: os.environ.get(name) for name in _THREAD_COUNTS}
    os.environ.update(dict.fromkeys(_THREAD_COUNTS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
