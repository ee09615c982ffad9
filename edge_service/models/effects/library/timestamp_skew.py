"""Two encoders that are not read at the same time."""

from ..contribution import Change, Constant, Contribution
from ..effect import Confirmation, Effect, Kind, Parameter, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    return (Change(Constant.POSITION_LAG, values["skew_s"]),)


EFFECT = Effect(
    name="timestamp_skew",
    description="The linear encoder is read later than the rotary one, which looks like stretch.",
    source="x_measured(t) = x(t - T): x - R theta by -R v T",
    kind=Kind.MEASUREMENT,
    parameters=(Parameter("skew_s", "s", "Delay of the linear channel.", -5e-3, 5e-3, 0.0, 5e-4),),
    contributions=_contributions,
    imitates=frozenset({"compliance"}),
    confirmation=Confirmation("encoder_lag", (Kind.LOST_MOTION, Kind.TRAVEL)),
)
