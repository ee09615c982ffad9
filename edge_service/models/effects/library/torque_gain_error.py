"""The motor gives another torque than it is told to."""

from ..contribution import Change, Constant
from ..effect import Effect, Kind, Term, amount

EFFECT = Effect(
    name="torque_gain_error",
    description="The torque constant is off, as with warm or aged magnets: all torques are scaled.",
    source="command = (1 + eps) torque: eps times the whole torque model",
    kind=Kind.DRIVE,
    parameters=(
        amount(
            "excess_share", "1", "Command over the torque that arrives, less 1.", -0.6, 2.0, 0.15
        ),
    ),
    contributions=lambda values: (Change(Constant.COMMAND_SHARE, values["excess_share"]),),
    term=Term.GAIN,
)
