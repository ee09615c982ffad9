"""The channels a trace or a driver may carry, in SI units (the trace file's columns)."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity: its column name, unit and meaning."""

    name: str
    unit: str
    description: str


TIME = "time_s"
TORQUE = "torque_command_nm"
ANGLE = "motor_angle_rad"
MOTOR_SPEED = "motor_speed_rad_s"
TABLE_POSITION = "table_position_m"
TABLE_SPEED = "table_speed_m_s"
SETPOINT = "position_setpoint_m"
TEMPERATURE = "temperature_c"
EXTERNAL_FORCE = "external_force_n"

CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel(TORQUE, "N m", "torque command at the motor shaft"),
        Channel(ANGLE, "rad", "rotary encoder, multi-turn"),
        Channel(MOTOR_SPEED, "rad/s", "speed as the drive derives it"),
        Channel(TABLE_POSITION, "m", "linear encoder"),
        Channel(TABLE_SPEED, "m/s", "table speed"),
        Channel(SETPOINT, "m", "commanded table position"),
        Channel(TEMPERATURE, "degC", "nut or housing temperature"),
        Channel(EXTERNAL_FORCE, "N", "measured external force on the table"),
    )
}
"""Every known channel except `time_s`, in the order in which they are written."""

POSITION_CHANNELS = (ANGLE, TABLE_POSITION)
