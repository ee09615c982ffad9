"""Frequency responses in the XML of SINUMERIK's auto servo tuning and of its measuring functions.

An auto servo tuning (`DynamicModelAxisController`) holds the response of the mechanics, motor speed
over torque in rad/(s N m), with its coherence, and what the tuning took from it. A measurement
(`ResponseTest...`) holds three spectra in the order own, cross, own: the response is the first over
the second, and its units are not told. Layout of both: eliasrhoden/Trace-Tools.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...messages.samples import Floats
from ..columns import TraceError
from .tuning_parser import MEASUREMENT_ROOT, SPECTRA, TUNING_ROOT, Complexes, TuningParser

LARGEST = 1e30
"""No response and no frequency is greater; nor is its inverse."""
_ROUNDING = 1e-6
_LOWEST = 5
"""One in so many frequencies, the lowest, shows the sign of the phase."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredResponse:
    """A frequency response as a control has measured it.

    Attributes:
        axis: name of the axis, or its number; empty where the file has neither.
        frequency_hz: rising, (n,).
        response: complex, (n,).
        coherence: share of the output's power that the input explains, 0 to 1, (n,).
        unit: of the response; empty where the file does not say it, or of a linear motor.
        averages: measurements behind each value; 1 where the file does not say it.
        stated: what the control has taken from it, by name with its unit.
    """

    axis: str
    frequency_hz: Floats
    response: Complexes
    coherence: Floats
    unit: str
    averages: float
    stated: dict[str, float] = field(default_factory=dict)


def is_tuning(head: bytes) -> bool:
    """Tell whether the first bytes of a file are those of such an XML."""
    return any(f"<{root}".encode() in head for root in (TUNING_ROOT, MEASUREMENT_ROOT))


def read_tuning(path: Path) -> MeasuredResponse:
    """Read the response of the mechanics. Raises TraceError, one line, for anything else."""
    try:
        with path.open("rb") as file:
            found = TuningParser(path, file)
    except OSError as error:
        raise TraceError(f"{path}: cannot be read ({error.strerror or error})") from None
    try:
        return _measured(found) if found.root == TUNING_ROOT else _from_spectra(found)
    except ValueError as error:
        raise TraceError(f"{path}: {error}") from None


def _measured(found: TuningParser) -> MeasuredResponse:
    if found.plant is None:
        raise ValueError("no measured response of the mechanics (m_pPlant); tune the axis first")
    frequency, response = found.plant.curve()
    if found.coherence is None:
        raise ValueError("a response without its coherence (m_pMeasCoherence)")
    at, values = found.coherence.curve()
    coherence = np.interp(frequency, at, values.real)
    unit = "rad/(s N m)" if found.rotary else ""
    return _checked(found, frequency, response, coherence, unit)


def _from_spectra(found: TuningParser) -> MeasuredResponse:
    """G = S_yy / S_uy and |S_uy|^2 / (S_uu S_yy), of a measurement with its spectra.

    Which of the two is conjugated in S_uy no file says: a mass lags behind its torque.
    """
    if len(found.spectra) < SPECTRA:
        raise ValueError(f"{len(found.spectra)} spectra; expected own, cross and own spectrum")
    curves = [each.curve() for each in found.spectra]
    frequency = curves[0][0]
    if any(not np.array_equal(frequency, each) for each, _ in curves):
        raise ValueError("spectra at different frequencies")
    output, cross, source = (values for _, values in curves)
    with np.errstate(all="ignore"):
        response = output / cross
        coherence = np.abs(cross) ** 2 / np.abs(output * source)
    lowest = response[: len(response) // _LOWEST + 1]
    lowest = lowest[np.isfinite(lowest)]
    if len(lowest) and np.median(lowest.imag) > 0.0:
        response = np.conj(response)
    return _checked(found, frequency, response, coherence, "")


def _checked(
    found: TuningParser, frequency: Floats, response: Complexes, coherence: Floats, unit: str
) -> MeasuredResponse:
    """The response where it is one. Raises ValueError for a coherence that is none."""
    kept = (frequency > 0.0) & (frequency < LARGEST) & np.isfinite(coherence)
    kept &= (np.abs(response) > 1.0 / LARGEST) & (np.abs(response) < LARGEST)
    if not kept.any():
        raise ValueError("a response without a number")
    if np.any((coherence[kept] < -_ROUNDING) | (coherence[kept] > 1.0 + _ROUNDING)):
        raise ValueError("a coherence that is not between 0 and 1")
    number = found.stated.get("axis")
    return MeasuredResponse(
        found.axis_name or ("" if number is None else f"{number:g}"),
        frequency[kept],
        response[kept],
        np.clip(coherence[kept], 0.0, 1.0),
        unit,
        found.stated.get("averages", 1.0),
        {name: each for name, each in found.stated.items() if name.endswith("kg_m2")},
    )
