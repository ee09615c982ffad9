"""Events for the tests of the diary."""

from edge_service.messages.event import Event, Severity

NS = 1_000_000_000
START_NS = 1_769_860_800 * NS


def event(number: int, kind: str = "note", axis: str = "X") -> Event:
    """An event that tells its number."""
    return Event(
        axis=axis,
        kind=kind,
        severity=Severity.INFO,
        message=f"{kind} {number}\nö",
        time_ns=START_NS + number,
        data={"number": number},
    )


def numbers(found) -> list[int]:
    """Numbers of events that were found."""
    return [each.event.data["number"] for each in found]
