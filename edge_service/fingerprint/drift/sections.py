"""Sections that several recordings have in common: the same move, repeated in each of them."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .moves import Move

FEWEST_REPEATS = 3
MOST_SECTIONS = 8
"""Of more, those with the most repeats are compared: each comparison makes all intervals wider."""
_SAME_WAY = 0.02
"""Moves are the same if they begin, end and run alike within this share of their way and speed."""
_SAME_DURATION = 0.1


@dataclass(frozen=True, slots=True)
class Section:
    """One move, or one move there and back, in every recording.

    Attributes:
        there: repeats in each recording; the first of all is the pattern.
        back: of the same way back at the same speed; empty where there is none.
    """

    there: tuple[tuple[Move, ...], ...]
    back: tuple[tuple[Move, ...], ...] = ()

    @property
    def pattern(self) -> Move:
        """Move that the others are like."""
        return self.there[0][0]

    @property
    def both_ways(self) -> bool:
        """Tell whether friction can be told from a load."""
        return bool(self.back)

    @property
    def repeats(self) -> tuple[int, ...]:
        """In each recording, of the direction that has fewer."""
        there = (len(moves) for moves in self.there)
        if not self.back:
            return tuple(there)
        return tuple(min(one, len(other)) for one, other in zip(there, self.back, strict=True))


def common_sections(recordings: Sequence[Sequence[Move]]) -> list[Section]:
    """Moves that every recording repeats, in the order of the first; there and back as one."""
    kinds = [kind for kind in _kinds(recordings) if min(map(len, kind)) >= FEWEST_REPEATS]
    sections: list[Section] = []
    taken: set[int] = set()
    for number, kind in enumerate(kinds):
        if number in taken:
            continue
        back = next(
            (
                k
                for k in range(number + 1, len(kinds))
                if k not in taken and _is_back(kind, kinds[k])
            ),
            None,
        )
        taken |= {number} if back is None else {number, back}
        sections.append(Section(kind, () if back is None else kinds[back]))
    most = sorted(sections, key=lambda each: -min(each.repeats))[:MOST_SECTIONS]
    return [each for each in sections if each in most]


def _kinds(recordings: Sequence[Sequence[Move]]) -> Iterator[tuple[tuple[Move, ...], ...]]:
    patterns: list[Move] = []
    members: list[list[list[Move]]] = []
    for place, moves in enumerate(recordings):
        for move in moves:
            known = next((k for k, each in enumerate(patterns) if is_same(each, move)), None)
            if known is None:
                known = len(patterns)
                patterns.append(move)
                members.append([[] for _ in recordings])
            members[known][place].append(move)
    for kind in members:
        yield tuple(tuple(moves) for moves in kind)


def is_same(first: Move, second: Move) -> bool:
    """Tell whether two moves are repeats of one."""
    way_m = _SAME_WAY * abs(first.end_m - first.start_m)
    return (
        first.context == second.context
        and abs(first.start_m - second.start_m) <= way_m
        and abs(first.end_m - second.end_m) <= way_m
        and abs(first.speed_m_s - second.speed_m_s) <= _SAME_WAY * abs(first.speed_m_s)
        and abs(first.duration_s - second.duration_s) <= _SAME_DURATION * first.duration_s
    )


def _is_back(kind: Sequence[Sequence[Move]], other: Sequence[Sequence[Move]]) -> bool:
    there, back = kind[0][0], other[0][0]
    turned = Move(
        back.context, back.end_m, back.start_m, -back.speed_m_s, back.duration_s, back.figures
    )
    return is_same(there, turned)


def most_frequent(moves: Sequence[Move]) -> str:
    """Most frequent move of a recording, in words."""
    counts = Counter(described(move) for move in moves)
    (words, count), *_ = counts.most_common(1)
    return f"{words}, {count} times"


def described(move: Move) -> str:
    """A move in words: its ends and its speed."""
    return (
        f"{1e3 * move.start_m:.4g} to {1e3 * move.end_m:.4g} mm at "
        f"{1e3 * abs(move.speed_m_s):.3g} mm/s"
    )


def mean_temperature(moves: Sequence[Move], name: str) -> float:
    """Mean of a figure over moves; NaN where it is not recorded."""
    values = [move.figures[name] for move in moves if name in move.figures]
    return float(np.mean(values)) if values else float("nan")
