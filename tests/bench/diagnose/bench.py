"""The benches of the diagnosis: a foreign plant, one beside the checkout, and real machines."""

from collections.abc import Collection

from .. import real_machines
from ..table import Progress, Table
from .foreign_table import run_foreign
from .second_plant import run_diagnosis_plant
from .seeded_errors import run_seeded_errors


def run_diagnose_bench(
    parts: Collection[str], quick: bool, seed: int, progress: Progress
) -> list[Table]:
    """Run some parts. Raises BenchError."""
    tables = []
    if "foreign" in parts:
        tables.append(run_foreign(20 if quick else 500, seed, progress))
    if "second-plant" in parts:
        tables.append(run_diagnosis_plant(seed, quick, progress))
    if "real-machines" in parts:
        tables.append(run_seeded_errors(real_machines.DATA, seed, progress))
    return tables
