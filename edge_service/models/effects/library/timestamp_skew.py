"""Two encoders that are not read at the same time."""

from ..contribution import Change, Constant
from ..effect import Confirmation, Effect, Kind, amount

EFFECT = Effect(
    name="timestamp_skew",
    description="The linear encoder is read later than the rotary one, which looks like stretch.",
    source="x_measured(t) = x(t - T): x - R theta by -R v T",
    kind=Kind.MEASUREMENT,
    parameters=(amount("skew_s", "s", "Delay of the linear channel.", -5e-3, 5e-3, 5e-4),),
    contributions=lambda values: (Change(Constant.POSITION_LAG, values["skew_s"]),),
    imitates=frozenset({"compliance"}),
    confirmation=Confirmation("encoder_lag", (Kind.LOST_MOTION, Kind.TRAVEL)),
)
