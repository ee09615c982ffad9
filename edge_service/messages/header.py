"""The four numbers that every payload carries."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Header:
    """Identity and times of one payload.

    Attributes:
        sequence: counts up by one per payload and publisher, from 0; a jump is a loss.
        boot_epoch: UNIX time in ns at which the publisher started; a new value means a restart,
            after which `sequence` begins again.
        source_time_ns: UNIX time in ns of the newest sample that the payload rests on.
        monotonic_time_ns: the publishing host's monotonic clock in ns at publication.
    """

    sequence: int
    boot_epoch: int
    source_time_ns: int
    monotonic_time_ns: int
