"""The benches of the diagnosis: a foreign plant, and real machines."""

from collections.abc import Collection, Iterator, Sequence
from functools import partial

from ...hidden_effects.cases import HiddenCase, foreign_plant, plan
from ...hidden_effects.score import CheckedCase, checked, total_lines, totals_of
from .. import real_machines
from ..table import Progress, Table, in_processes
from .seeded_errors import run_seeded_errors


def run_diagnose_bench(
    parts: Collection[str], quick: bool, seed: int, progress: Progress
) -> list[Table]:
    tables = []
    if "foreign" in parts:
        tables.append(run_foreign(20 if quick else 500, seed, progress))
    if "real-machines" in parts:
        tables.append(run_seeded_errors(real_machines.DATA, seed, progress))
    return tables


def run_foreign(count: int, seed: int, progress: Progress) -> Table:
    """Outcomes of a mixture of `count` cases by their kind; below them what was said of each."""
    rows = sorted(run_cases(plan(foreign_plant(), count, seed), progress), key=lambda r: r.words)
    totals = totals_of(rows)
    counts = [{"kind": kind, **each} for kind, each in totals["outcomes"].items()]
    return Table.of(counts, *total_lines(totals)[len(counts) :], "", *(row.words for row in rows))


def run_cases(cases: Sequence[HiddenCase], progress: Progress) -> Iterator[CheckedCase]:
    """All cases of the foreign plant over some processes, as they are done."""
    jobs = [partial(checked, foreign_plant(), case) for case in cases]
    for count, (_, row) in enumerate(in_processes(jobs), start=1):
        progress(f"{count} of {len(cases)}: {row.words}")
        yield row
