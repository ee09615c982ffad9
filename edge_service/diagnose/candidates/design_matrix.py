"""All candidate columns of a session at once, and the sums of products that fits need."""

import concurrent.futures
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from ...messages.samples import Booleans, Floats
from ...models.effects.effect import Effect
from ..session.healthy_prior import Tolerated
from ..session.session import Integers, Session
from .empirical_shapes import free_forms
from .regressor import Atom, atoms_of

_MOST_OF_GAP = 10.0
"""Coefficients are held where their column makes up to so many times the gap of its channel: two
columns that are nearly one must not stand against each other."""
_LEAST_OF_FAMILY = 1e-8
"""Energy of an atom over that of the strongest of its family, below which it is not there."""
_STRICT = ("saturation",)
"""Effects whose column holds the measured torque: at any strength but 1 it would explain itself."""
_STRICT_SIGMA = 0.05


Columns = npt.NDArray[np.float32]
"""Half the memory; products of theirs are summed in double precision."""


_CHUNK = 4096
"""Rows whose products are summed at once, in double precision."""


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """Sums over the rows of one channel: gram (p, p), cross (p,), square of the gap, rows."""

    gram: Floats
    cross: Floats
    square: float
    rows: int

    @classmethod
    def of(cls, columns: Columns, gap: Floats, rows: Integers | None = None) -> Self:
        """Of columns (n, p) and the gap (n,), or of some of their rows only.

        Most columns show in one channel only.
        """
        chosen = np.arange(len(gap)) if rows is None else rows
        shown = np.flatnonzero([np.any(column) for column in columns.T])
        gram = np.zeros((columns.shape[1], columns.shape[1]))
        cross = np.zeros(columns.shape[1])
        gram[np.ix_(shown, shown)], cross[shown] = _products(columns, shown, gap, chosen)
        return cls(gram, cross, float(gap[chosen] @ gap[chosen]), len(chosen))


@dataclass(frozen=True, slots=True, eq=False)
class Dictionary:
    """Candidate atoms and their columns.

    Attributes:
        atoms: the first `tolerated` of them are what a healthy axis may have.
        mean, precision: prior of the coefficient of each column, (p,); 0 knows nothing.
        first: first column of each atom, (n_atoms + 1,).
        columns, sums: by channel, (n, p).
        alternatives: how many atoms share name and form with each atom.
    """

    atoms: tuple[Atom, ...]
    tolerated: int
    mean: Floats
    precision: Floats
    first: Integers
    columns: Mapping[str, Columns]
    sums: Mapping[str, Sums]
    alternatives: tuple[int, ...]

    @classmethod
    def of_session(
        cls,
        session: Session,
        tolerated: Sequence[Tolerated],
        library: Sequence[Effect],
        more: Sequence[Atom] = (),
    ) -> Self:
        """The dictionary of a session and of the entries that may explain its gap.

        Args:
            more: candidates behind those of the library.
        """
        names = {effect.name for effect in library}
        entries: list[Atom] = [a for effect in library for a in atoms_of(effect, session)]
        if names:
            entries += [form for form in free_forms(session) if form.name in names]
        atoms = [*(each.atom for each in tolerated), *entries, *more]
        columns = {name: _columns(atoms, session, name) for name in session.channels}
        sums = {name: Sums.of(each, session.channels[name].gap) for name, each in columns.items()}
        first = np.concatenate(([0], np.cumsum([atom.size for atom in atoms]))).astype(np.int64)
        mean, precision = np.zeros(int(first[-1])), _bounding(session, sums)
        mean[: len(tolerated)] = [each.mean for each in tolerated]
        precision[: len(tolerated)] = [each.sigma**-2 for each in tolerated]
        for k, atom in enumerate(atoms[len(tolerated) :], start=len(tolerated)):
            if atom.name in _STRICT:
                mean[first[k]], precision[first[k]] = 1.0, _STRICT_SIGMA**-2
        shapes = Counter((atom.name, atom.form) for atom in entries)
        forms = Counter(atom.name for atom in more)
        alternatives = (
            *(1 for _ in tolerated),
            *(shapes[atom.name, atom.form] for atom in entries),
            *(forms[atom.name] for atom in more),
        )
        count = len(tolerated)
        return cls(tuple(atoms), count, mean, precision, first, columns, sums, alternatives)

    def restricted(
        self, count: int, session: Session, kept: Mapping[str, Booleans]
    ) -> "Dictionary":
        """Its first `count` atoms to be weighed by some rows of each channel, without columns."""
        end = int(self.first[count])
        return replace(
            self,
            atoms=self.atoms[:count],
            mean=self.mean[:end],
            precision=self.precision[:end],
            first=self.first[: count + 1],
            columns={},
            sums={
                name: Sums.of(self.columns[name][:, :end], rows.gap, np.flatnonzero(kept[name]))
                for name, rows in session.channels.items()
            },
            alternatives=self.alternatives[:count],
        )

    def indices(self, atoms: Sequence[int]) -> Integers:
        """Columns of some atoms, in their order."""
        parts = [np.arange(self.first[a], self.first[a + 1]) for a in atoms]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)

    @property
    def candidates(self) -> list[int]:
        """Atoms that are not merely tolerated, and that show."""
        energy = sum(np.diag(each.gram) / (each.square or 1.0) for each in self.sums.values())
        of_atom = np.add.reduceat(energy, self.first[:-1])
        strongest: dict[tuple[str, str], float] = {}
        for atom, each in zip(self.atoms, of_atom.tolist(), strict=True):
            family = atom.name, atom.form
            strongest[family] = max(strongest.get(family, 0.0), each)
        return [
            k
            for k in range(self.tolerated, len(self.atoms))
            for atom in (self.atoms[k],)
            if of_atom[k] > _LEAST_OF_FAMILY * strongest[atom.name, atom.form]
        ]

    def modelled(self, channel: str, atoms: Sequence[int], coefficients: Floats) -> Floats:
        """Gap in a channel as atoms model it, (n,)."""
        return self.columns[channel][:, self.indices(atoms)].astype(np.float64) @ coefficients


def _bounding(session: Session, sums: Mapping[str, Sums]) -> Floats:
    """Precision of the coefficient of each column that bounds it by the gap, (p,)."""
    held = [
        np.diag(each.gram) / max(_MOST_OF_GAP**2 * float(np.sum(rows.gap**2)), 1e-300)
        for name, each in sums.items()
        for rows in (session.channels[name],)
    ]
    found: Floats = np.max(held, axis=0)
    return found


def _products(
    columns: Columns, shown: Integers, gap: Floats, rows: Integers
) -> tuple[Floats, Floats]:
    """Sums of products of the shown columns, (p, p), and of theirs with the gap, (p,)."""
    gram, cross = np.zeros((len(shown), len(shown))), np.zeros(len(shown))
    for start in range(0, len(rows), _CHUNK):
        some = rows[start : start + _CHUNK]
        part = columns[np.ix_(some, shown)].astype(np.float64)
        gram += part.T @ part
        cross += part.T @ gap[some]
    return gram, cross


def _columns(atoms: Sequence[Atom], session: Session, channel: str) -> Columns:
    """Columns of all atoms, (n, p).

    Families that cannot show in the channel are not evaluated, and take no memory.
    """
    families: dict[tuple[str, str], Atom] = {}
    for atom in atoms:
        families.setdefault((atom.name, atom.form), atom)
    shows = {
        family: bool(np.any(atom.columns(session, channel))) for family, atom in families.items()
    }
    first = np.cumsum([0, *(atom.size for atom in atoms)])
    found = np.zeros((int(first[-1]), len(session.channels[channel].gap)), np.float32).T

    def fill(k: int) -> None:
        if shows[atoms[k].name, atoms[k].form]:
            found[:, first[k] : first[k + 1]] = atoms[k].columns(session, channel)

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(fill, range(len(atoms))))
    return found
