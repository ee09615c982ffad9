"""Reasons given for distrusted channels: `code: sentence`, also beside a number."""

from ...messages.features import FAULT_WORDS, Fault

_ALONE = "preload from torque alone"
_CODES = {
    Fault.TORQUE_STUCK: "torque_stuck",
    Fault.NO_TORQUE: "torque_missing",
    Fault.ANGLE_STUCK: "angle_stuck",
    Fault.NO_POSITION: "angle_missing",
}
_OF_TABLE = {
    Fault.TABLE_STUCK: "table_stuck",
    Fault.TABLE_DISAGREES: "table_disagrees",
    Fault.TABLE_DOUBTED: "table_doubted",
    Fault.NO_TABLE: "table_missing",
}


def channel_reasons(fault: Fault) -> tuple[str, ...]:
    """Caveats on the channels of an interval; for the table, the first that applies."""
    said = [f"{code}: {FAULT_WORDS[kind]}" for kind, code in _CODES.items() if kind in fault]
    table = [kind for kind in _OF_TABLE if kind in fault][:1]
    said += [f"{_OF_TABLE[kind]}: {FAULT_WORDS[kind]}; {_ALONE}" for kind in table]
    if Fault.TABLE_SHIFTED in fault:
        said.append(f"table_shifted: {FAULT_WORDS[Fault.TABLE_SHIFTED]}")
    return tuple(said)
