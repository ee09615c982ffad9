"""The interacting bank of sliding innovation filters (thesis, eqs. 4.4.7-4.4.12)."""

import numpy as np

from ....messages.samples import Floats
from .filter_bank import BankOutput, LinearStep
from .kalman import BankStart, CompiledBank, run_bank


class SlidingInnovationBank(CompiledBank):
    """FilterBank whose gains are K = C^+ sat(|e| / delta) (thesis, eq. 4.4.10).

    A state that no measurement sees has a row of zeros in C^+, so its gain is zero: with
    position measurements alone, the filter predicts the speed and never corrects it.

    Args:
        boundary: delta, the width of the boundary layer per measurement, in its unit, (m,).
    """

    def __init__(self, boundary: Floats) -> None:
        super().__init__(checked_boundary(boundary))


def run_sliding_innovation_bank(
    step: LinearStep, drives: Floats, measurements: Floats, start: BankStart, boundary: Floats
) -> BankOutput:
    """`run_kalman_bank` with the gains of the sliding innovation filter, boundary (m,)."""
    return run_bank(step, drives, measurements, start, checked_boundary(boundary))


def checked_boundary(boundary: Floats) -> Floats:
    """The boundary as floats; ValueError unless every width is finite and above 0."""
    widths = np.asarray(boundary, dtype=np.float64)
    if widths.ndim != 1 or not len(widths) or not (np.isfinite(widths) & (widths > 0.0)).all():
        raise ValueError("boundary: expected one finite width above 0 per measurement")
    return widths
