"""Cases of a batch: each a recording, or a folder with those of one session."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from ...config import ConfigError
from ...recordings.forms.registry import is_recording


@dataclass(frozen=True, slots=True)
class Case:
    """One case.

    Attributes:
        name: of its folder among the results; no two of a batch are alike.
        traces: recordings of one axis and one session.
    """

    name: str
    traces: tuple[Path, ...]


def cases_of(given: Sequence[Path]) -> list[Case]:
    """Cases in the order in which they are given.

    Args:
        given: recordings, and folders whose recordings belong together.

    Raises:
        ConfigError: a path that is not there, or a folder without a recording.
    """
    names: set[str] = set()
    cases = []
    for path in given:
        traces = tuple(_recordings(path))
        if not traces:
            raise ConfigError(f"{path}: no recording in it; expected a file or a folder with some")
        name = path.stem if path.is_file() else path.resolve().name
        alike = (name if number == 1 else f"{name}_{number}" for number in count(1))
        names.add(name := next(each for each in alike if each not in names))
        cases.append(Case(name, traces))
    return cases


def _recordings(path: Path) -> Iterator[Path]:
    if not path.exists():
        raise ConfigError(f"{path}: no such file or folder")
    if path.is_file():
        yield path.resolve()
    else:
        yield from (each.resolve() for each in sorted(path.iterdir()) if is_recording(each))
