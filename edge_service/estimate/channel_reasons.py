"""Reasons given for distrusted channels: `code: sentence`, also beside a number."""

from ..messages.features import Fault

_ALONE = "preload from torque alone"
_REASONS = (
    (Fault.TORQUE_STUCK, "torque_stuck: the torque repeats one value while the axis moves"),
    (Fault.NO_TORQUE, "torque_missing: the torque has no value"),
    (Fault.ANGLE_STUCK, "angle_stuck: the motor angle stands still while the axis moves"),
    (Fault.NO_POSITION, "angle_missing: the position of the motor has no value"),
)
_OF_TABLE = (
    (
        Fault.TABLE_STUCK,
        f"table_stuck: the linear encoder stands still while the motor turns; {_ALONE}",
    ),
    (
        Fault.TABLE_DISAGREES,
        f"table_disagrees: the linear encoder does not follow the motor; {_ALONE}",
    ),
    (
        Fault.TABLE_DOUBTED,
        f"table_doubted: the linear encoder agrees again, but not yet for long enough; {_ALONE}",
    ),
    (Fault.NO_TABLE, f"table_missing: the linear encoder has no value; {_ALONE}"),
)
_SHIFTED = "table_shifted: the zero of the linear encoder may have shifted"


def channel_reasons(fault: Fault) -> tuple[str, ...]:
    """Caveats on the channels of an interval; for the table, the first that applies."""
    said = [sentence for kind, sentence in _REASONS if kind in fault]
    said += [sentence for kind, sentence in _OF_TABLE if kind in fault][:1]
    if Fault.TABLE_SHIFTED in fault:
        said.append(_SHIFTED)
    return tuple(said)
