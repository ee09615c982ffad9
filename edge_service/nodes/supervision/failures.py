"""Errors in single messages: borne, counted, and told once a minute for each kind."""

from collections.abc import Callable
from functools import partial
from types import TracebackType

from .words import said

SHOWN_S = 5.0
TOLD_AGAIN_S = 60.0
_MOST_KINDS = 100


class Failures:
    """Count of the messages that could not be handled.

    Args:
        tell: called with the task and the error in words.
        clock: monotonic, s.
    """

    def __init__(self, tell: Callable[[str, str], None], clock: Callable[[], float]) -> None:
        self.count = 0
        self._tell = tell
        self._clock = clock
        self._told_s: dict[tuple[str, str, str], float] = {}
        self._last = (float("-inf"), "")

    def borne(self, where: str, axis: str = "") -> "Borne":
        """Context in which an error is counted and goes no further."""
        return Borne(partial(self.note, where, axis))

    def now(self) -> list[str]:
        """Messages that could not be handled in the last seconds."""
        at_s, line = self._last
        return [line] if self._clock() - at_s < SHOWN_S else []

    def note(self, where: str, axis: str, error: Exception) -> None:
        """Count an error; tell of it unless that was done a short while ago."""
        self.count += 1
        now_s, kind = self._clock(), (where, axis[:64], type(error).__name__)
        reason = f"cannot handle a message{' of axis ' + kind[1] if axis else ''}: {said(error)}"
        self._last = (now_s, f"{where} {reason}")
        if now_s - self._told_s.get(kind, float("-inf")) < TOLD_AGAIN_S:
            return
        if len(self._told_s) >= _MOST_KINDS:
            self._told_s.clear()
        self._told_s[kind] = now_s
        self._tell(where, reason)


class Borne:
    """Context that bears errors, each told to `note`; a cancellation passes."""

    def __init__(self, note: Callable[[Exception], None]) -> None:
        self._note = note

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _where: TracebackType | None,
    ) -> bool:
        if not isinstance(error, Exception):
            return False
        self._note(error)
        return True
