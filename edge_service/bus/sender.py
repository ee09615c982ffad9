"""Order of the payloads of one key: one publisher at a time, none twice, none overtaken."""

from ..messages.header import Header
from .refusals import Refusal

MOST_JUMP = 100_000
"""So many payloads may be lost at once; a longer jump of the sequence is another's."""


class Sender:
    """The publisher that is heard on one key.

    Another one is heard once this one has been silent for a moment: it was restarted. Until then
    it is a rival, whatever its boot epoch says; and whatever sequence number a stranger uses, it
    is believed for no longer.

    Args:
        patience_s: silence after which another is heard, s.
    """

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._header: Header | None = None
        self._heard_s = 0.0
        self.lost = 0
        """Payloads that never arrived, by holes in the sequence."""
        self.restarts = 0
        """Changes of the publisher."""

    def judge(self, header: Header, arrival_s: float) -> Refusal | None:
        """Take a payload in; why it must not be read, if so.

        Args:
            arrival_s: when it came, on a clock that never goes back, s.
        """
        refusal = self._refusal(header)
        if refusal is not None and arrival_s - self._heard_s < self._patience_s:
            return refusal
        self._count(header, known=refusal is None)
        self._header, self._heard_s = header, arrival_s
        return None

    def _refusal(self, header: Header) -> Refusal | None:
        last = self._header
        if last is None:
            return None
        if header.boot_epoch != last.boot_epoch:
            return Refusal.RIVAL
        if header.sequence <= last.sequence:
            return Refusal.LATE
        return Refusal.RIVAL if header.sequence - last.sequence > MOST_JUMP else None

    def _count(self, header: Header, *, known: bool) -> None:
        if self._header is None:
            return
        if known:
            self.lost += header.sequence - self._header.sequence - 1
        else:
            self.restarts += 1
