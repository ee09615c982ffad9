"""Features that are left of a fast sensor's signal at the edge."""

from .estimate import Frozen
from .names import Column


class OrderPeak(Frozen):
    """Strength of a signal at an order, per revolution of the screw.

    Attributes:
        order: where the peak is, near the nominal one: balls slip.
        amplitude: in the sensor's unit.
        floor: typical amplitude beside it; a peak that is not well above it is none.
    """

    order: float
    amplitude: float
    floor: float


class VibrationFeatures(Frozen):
    """One interval of one sensor of one axis.

    Attributes:
        sensor, unit: of the signal.
        time_s: end of the interval on the axis' clock, s.
        duration_s: its length, s.
        rms, peak, crest_factor, kurtosis: of the signal without its mean; a Gaussian one has a
            kurtosis of 3.
        bands: name -> rms of the part of the signal in that band of frequencies.
        turns: revolutions of the screw in the interval; None where the angle is not known.
        orders: name -> peak of the signal; None where the screw turned too little or turned round.
        envelope_orders: the same of the envelope of the highest band: what taps again and again.
    """

    sensor: Column
    unit: str
    time_s: float
    duration_s: float
    rms: float
    peak: float
    crest_factor: float | None
    kurtosis: float | None
    bands: dict[str, float]
    turns: float | None
    orders: dict[str, OrderPeak | None]
    envelope_orders: dict[str, OrderPeak | None]
