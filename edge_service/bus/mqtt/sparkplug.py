"""Sparkplug B 3.0: this service as an edge node, every axis as a device of it."""

from collections.abc import Callable, Mapping, Sequence

from ...clock import now_ns
from ...messages.topics import EVENT, PRELOAD
from ..spool.message import Message
from .axis_metrics import metrics_of, unknown_metrics
from .packet import GONE, Packet
from .sparkplug_payload import DataType, Metric, Value, decode_values, encode_payload

REBIRTH = "Node Control/Rebirth"


def _unix_ms() -> int:
    return now_ns() // 1_000_000


class Sparkplug:
    """Birth and death certificates, and data by exception.

    A death certificate carries the number of the birth that it belongs to (`bdSeq`), every other
    message a number that counts from 0 to 255 and begins with a birth. Data say what has changed
    since the device was last sent; what is late goes whole, marked as historical.

    Args:
        group, node: the names under which hosts find us.
        unix_ms: the clock, UNIX time in ms.
    """

    def __init__(self, group: str, node: str, unix_ms: Callable[[], int] = _unix_ms) -> None:
        self._group, self._node, self._unix_ms = group, node, unix_ms
        self._birth = self._next = 0
        self._sent: dict[str, dict[str, Value]] = {}
        self.commands: str | None = self._topic("NCMD")
        self.described: str | None = None

    def will(self, session: int) -> Packet:
        """The death certificate of the connection that begins (quality 1, 6.4.21)."""
        self._birth = session % 256
        return self.farewell()

    def farewell(self) -> Packet:
        """The death certificate."""
        now_ms = self._unix_ms()
        payload = encode_payload([self._birth_number(now_ms)], now_ms, None)
        return Packet(self._topic("NDEATH"), payload, qos=1)

    def greeting(self, newest: Mapping[str, Message]) -> list[Packet]:
        """Births of the node and of every axis that is known and not gone."""
        self._next = 0
        now_ms = self._unix_ms()
        rebirth = Metric(REBIRTH, DataType.BOOLEAN, False, now_ms)
        node = self._packet("NBIRTH", [self._birth_number(now_ms), rebirth])
        axes = dict.fromkeys(axis_of(topic) for topic in newest)
        self._sent.clear()
        return [node, *(self._device_birth(a, newest) for a in axes if not is_gone(a, newest))]

    def packets(self, message: Message, newest: Mapping[str, Message], late: bool) -> list[Packet]:
        """The data of a message; a birth before them, or a death instead, where due."""
        axis, _, topic = message.topic.partition("/")
        if topic == GONE:
            return self._death(axis) if is_gone(axis, newest) else []
        if is_gone(axis, newest) and message.number > newest[f"{axis}/{GONE}"].number:
            return []  # of a device that is dead; its next birth says it
        packets = [] if axis in self._sent else [self._device_birth(axis, newest)]
        metrics = metrics_of(topic, message.payload)
        if not late:
            metrics = self._news(axis, metrics)
        if metrics:
            packets.append(self._packet("DDATA", metrics, axis, historical=late))
        return packets

    def asks_for_greeting(self, command: bytes) -> bool:
        """Tell whether a command is a request to be born again; what is none asks for nothing."""
        try:
            return decode_values(command).get(REBIRTH) is True
        except ValueError:
            return False

    def outdated(self, topic: str, payload: bytes) -> Sequence[Packet]:
        """Nothing: no description is kept."""
        return ()

    def _news(self, axis: str, metrics: list[Metric]) -> list[Metric]:
        """Metrics unlike those sent last; an event is new even if it is the same again."""
        sent = self._sent[axis]
        metrics = [
            each
            for each in metrics
            if each.name.startswith(f"{EVENT.name}/") or sent[each.name] != each.value
        ]
        sent |= {each.name: each.value for each in metrics}
        return metrics

    def _death(self, axis: str) -> list[Packet]:
        known = self._sent.pop(axis, None) is not None
        return [self._packet("DDEATH", [], axis)] if known else []

    def _device_birth(self, axis: str, newest: Mapping[str, Message]) -> Packet:
        metrics = {each.name: each for each in unknown_metrics(self._unix_ms())}
        for message in newest.values():
            if axis_of(message.topic) == axis and not message.topic.endswith(f"/{GONE}"):
                topic = message.topic.partition("/")[2]
                metrics |= {each.name: each for each in metrics_of(topic, message.payload)}
        self._sent[axis] = {name: each.value for name, each in metrics.items()}
        in_order = sorted(metrics.values(), key=lambda each: each.time_ms)
        return self._packet("DBIRTH", in_order, axis)

    def _birth_number(self, now_ms: int) -> Metric:
        return Metric("bdSeq", DataType.INT64, self._birth, now_ms)

    def _packet(
        self, kind: str, metrics: list[Metric], axis: str | None = None, *, historical: bool = False
    ) -> Packet:
        seq, self._next = self._next, (self._next + 1) % 256
        payload = encode_payload(metrics, self._unix_ms(), seq, historical=historical)
        return Packet(self._topic(kind, axis), payload, qos=0)

    def _topic(self, kind: str, axis: str | None = None) -> str:
        return "/".join(["spBv1.0", self._group, kind, self._node, *([axis] if axis else [])])


def axis_of(topic: str) -> str:
    """The axis of a topic `{axis}/{topic}`."""
    return topic.partition("/")[0]


def is_gone(axis: str, newest: Mapping[str, Message]) -> bool:
    """Tell whether an axis was said to be gone, and no estimate came since."""
    gone, estimate = newest.get(f"{axis}/{GONE}"), newest.get(f"{axis}/{PRELOAD.name}")
    return gone is not None and (estimate is None or gone.number > estimate.number)
