"""`edge-service check-diagnosis` at length, on the plant that shares no code with the library."""

from collections.abc import Iterator, Sequence
from functools import partial

from ...hidden_effects.cases import HiddenCase, foreign_plant, plan
from ...hidden_effects.score import CheckedCase, checked, total_lines, totals_of
from ..table import Progress, Table, in_processes


def run_cases(cases: Sequence[HiddenCase], progress: Progress) -> Iterator[CheckedCase]:
    """All cases over some processes, as they are done."""
    jobs = [partial(checked, foreign_plant(), case) for case in cases]
    for count, (_, row) in enumerate(in_processes(jobs), start=1):
        progress(f"{count} of {len(cases)}: {row.words}")
        yield row


def run_foreign(count: int, seed: int, progress: Progress) -> Table:
    """Outcomes of a mixture of `count` cases by their kind; below them what was said of each."""
    rows = sorted(run_cases(plan(foreign_plant(), count, seed), progress), key=lambda r: r.words)
    totals = totals_of(rows)
    counts = [{"kind": kind, **each} for kind, each in totals["outcomes"].items()]
    shrinks = total_lines(totals)[len(counts) :]
    return Table.of(counts, *shrinks, "", *(row.words for row in rows))
