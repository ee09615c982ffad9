"""Freshness of one input, and the order in which its payloads came."""

from dataclasses import replace

from ...messages.header import Header

NS_PER_S = 1_000_000_000


def moved(time_ns: int | None, step_ns: int) -> int | None:
    """Time as a clock shows it that was set by a step, ns."""
    return None if time_ns is None else time_ns + step_ns


class InputWatch:
    """Freshness and order of one topic of one axis.

    Two times count, and the older one decides: the newest sample's (`source_time_ns`), so that old
    data that arrive late are old, and the arrival's, so that a source whose clock runs ahead goes
    stale too. A reader's clock that was set back makes the input stale until the next payload.
    """

    def __init__(self, stale_after_s: float) -> None:
        self.stale_after_s = stale_after_s
        self._stale_after_ns = round(stale_after_s * NS_PER_S)
        self._arrival_ns = 0
        self.header: Header | None = None
        self.lost = 0
        """Payloads missing in the sequence since the first one heard."""

    def accept(self, header: Header, now_ns: int) -> bool:
        """Take a payload in; False if it is older than one already heard.

        A higher boot epoch is a restarted publisher, whose sequence begins again. A lower one is a
        latecomer, unless the known publisher fell silent (its host's clock may have been set back).
        """
        last = self.header
        if last is not None:
            if header.boot_epoch == last.boot_epoch:
                if header.sequence <= last.sequence:
                    return False
                self.lost += header.sequence - last.sequence - 1
            elif header.boot_epoch < last.boot_epoch and not self._silent(now_ns):
                return False
        self.header = header
        self._arrival_ns = now_ns
        return True

    def age_s(self, now_ns: int) -> float | None:
        """Time since the newest sample, s; None if nothing was heard."""
        if self.header is None:
            return None
        return max(now_ns - self.header.source_time_ns, now_ns - self._arrival_ns, 0) / NS_PER_S

    def is_stale(self, now_ns: int) -> bool:
        """Tell whether there is no payload that may still be read as present."""
        if self.header is None or self._silent(now_ns):
            return True
        return now_ns - self.header.source_time_ns > self._stale_after_ns

    def move(self, step_ns: int) -> None:
        """The clock was set by a step, ns."""
        self._arrival_ns += step_ns
        if self.header is not None:
            source_ns = max(self.header.source_time_ns + step_ns, 0)
            self.header = replace(self.header, source_time_ns=source_ns)

    @property
    def stale_since_ns(self) -> int:
        """UNIX time in ns at which the last payload becomes stale; 0 if nothing was heard."""
        if self.header is None:
            return 0
        return min(self.header.source_time_ns, self._arrival_ns) + self._stale_after_ns

    def _silent(self, now_ns: int) -> bool:
        return abs(now_ns - self._arrival_ns) > self._stale_after_ns
