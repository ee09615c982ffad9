"""Comparison of what was there with what was said: by strength, as a matrix, and in words."""

from collections import Counter
from collections.abc import Sequence

from .rows import BenchRow, is_first, is_known

NOTHING, UNKNOWN = "nothing", "unknown"
_LIKELY = 0.5


def named_first(row: BenchRow) -> str:
    """Name that leads an answer: the cause where it is tied with it, or that it is not known."""
    if is_first(row):
        first = max(row.named, key=lambda name: row.named[name])
        known = [name for name in (first, *row.classes[first]) if name in row.case.causes]
        return known[0] if known else first
    likely = {name: p for name, p in row.named.items() if p > _LIKELY}
    if likely:
        return max(likely, key=lambda name: likely[name])
    return UNKNOWN if row.verdict == "unknown" else NOTHING


def confusion(rows: Sequence[BenchRow]) -> dict[str, Counter[str]]:
    """Healthy, single and withheld causes -> how often each answer leads."""
    found: dict[str, Counter[str]] = {}
    for row in rows:
        if len(row.case.causes) < 2:
            found.setdefault(_label(row), Counter())[named_first(row)] += 1
    return dict(sorted(found.items(), key=lambda item: (item[0].startswith("no "), item[0])))


def confusion_matrix(rows: Sequence[BenchRow]) -> list[str]:
    """The confusion as a table with a line for each cause; columns bear the numbers of lines."""
    counts = confusion(rows)
    said = {name for each in counts.values() for name in each}
    names = sorted(name for name in {*counts, *said} if not name.startswith("no "))
    names = [name for name in names if name not in (NOTHING, UNKNOWN)]
    number = {name: k for k, name in enumerate(names, start=1)}
    columns = [name for name in names if name in said]
    head = [f"{number[name]:>3}" for name in columns] + [f"{NOTHING:>8}", f"{UNKNOWN:>8}"]
    lines = [f"{'':<31}{''.join(head)}"]
    for label, each in {**{name: Counter[str]() for name in names}, **counts}.items():
        cells = [f"{each[name] or '.':>3}" for name in columns]
        cells += [f"{each[name] or '.':>8}" for name in (NOTHING, UNKNOWN)]
        lines.append(f"{number.get(label, ''):>3} {label:<27}{''.join(cells)}")
    return lines


def verdicts_of_each(rows: Sequence[BenchRow]) -> list[str]:
    """Healthy, single and withheld causes -> verdicts with all names, one line each."""
    said: dict[str, Counter[str]] = {}
    for row in rows:
        if len(row.case.causes) < 2:
            names = "+".join(sorted(row.named)) or NOTHING
            said.setdefault(_label(row), Counter())[f"{row.verdict}:{names}"] += 1
    return [
        f"{label:<30} {', '.join(f'{what} {count}' for what, count in each.most_common())}"
        for label, each in sorted(said.items())
    ]


def by_strength(rows: Sequence[BenchRow]) -> list[str]:
    """Single causes -> top-1 by strength, one line each."""
    singles = [r for r in rows if len(r.case.causes) == 1 and is_known(r) and not r.case.withheld]
    lines = []
    for cause in sorted({row.case.causes[0] for row in singles}):
        parts = []
        for strength in sorted({row.case.strength for row in singles}):
            mine = [
                is_first(row)
                for row in singles
                if row.case.causes[0] == cause and row.case.strength == strength
            ]
            if mine:
                parts.append(f"x{strength:g} {sum(mine)} of {len(mine)}")
        lines.append(f"{cause:<26} {', '.join(parts)}")
    return lines


def _label(row: BenchRow) -> str:
    cause = row.case.causes[0] if row.case.causes else "healthy"
    return f"no {cause}" if row.case.withheld else cause
