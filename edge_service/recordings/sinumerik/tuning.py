"""Frequency responses in the XML of SINUMERIK's auto servo tuning and of its measuring functions.

An auto servo tuning (`DynamicModelAxisController`) holds the response of the mechanics, motor speed
over torque in rad/(s N m), with its coherence, and what the tuning took from it. A measurement
(`ResponseTest...`) holds three spectra in the order own, cross, own: the response is the first over
the second, and its units are not told. Numbers are base 85 with an alphabet that avoids what XML
would escape: five digits are four bytes, the greatest first, and `.` is four zeros, as the `z` of
Ascii85. Layout of both: eliasrhoden/Trace-Tools.
"""

import base64
import math
import string
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO
from xml.etree.ElementTree import Element, TreeBuilder

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats
from ..columns import TraceError
from ..forms import head_of
from .xml_reader import XmlReader

TUNING_ROOT, MEASUREMENT_ROOT = "DynamicModelAxisController", "ResponseTest"
MOST_FREQUENCIES, MOST_ELEMENTS, LARGEST_BYTES = 1 << 17, 1 << 17, 1 << 25
SPECTRA = 3
LARGEST = 1e30
"""No response and no frequency is greater; nor is its inverse."""
_ROUNDING = 1e-6
_LOWEST = 5
"""One in so many frequencies, the lowest, shows the sign of the phase."""
_RESPONSES = {"FrequencyResponseFunction", "CrossSpectrum"}
_STATED = {
    "m_dMotorInertia": "motor_inertia_kg_m2",
    "m_dTotalInertia": "total_inertia_kg_m2",
    "m_uNumberOfAverages": "averages",
    "m_uAxis": "axis",
}
ALPHABET = string.digits + string.ascii_lowercase + string.ascii_uppercase
ALPHABET += "!#$`()*+-/:;=?@[]^_{|}~"
_ASCII85 = str.maketrans(ALPHABET, "".join(map(chr, range(33, 118))))

Complexes = npt.NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredResponse:
    """A frequency response as a control has measured it."""

    axis: str  # name of the axis, or its number; empty where the file has neither
    frequency_hz: Floats  # rising, (n,)
    response: Complexes  # complex, (n,)
    coherence: Floats  # share of the output's power that the input explains, 0 to 1, (n,)
    unit: str  # of the response; empty where the file does not say it, or of a linear motor
    averages: float  # measurements behind each value; 1 where the file does not say it
    # what the control has taken from it, by name with its unit
    stated: dict[str, float] = field(default_factory=dict)


def is_tuning(path: Path) -> bool:
    """Return whether a file begins as such an XML; what cannot be opened is none."""
    with suppress(OSError):
        head = head_of(path)
        return any(f"<{root}".encode() in head for root in (TUNING_ROOT, MEASUREMENT_ROOT))
    return False


def read_tuning(path: Path) -> MeasuredResponse:
    """Read the response of the mechanics. Raises TraceError, one line, for anything else."""
    try:
        with path.open("rb") as file:
            root = _read_tree(path, file)
        return _of_tuning(root) if root.tag == TUNING_ROOT else _of_spectra(root)
    except OSError as error:
        raise TraceError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise TraceError(f"{path}: {error}") from None


def _read_tree(path: Path, file: IO[bytes]) -> Element:
    """The elements of a file. Raises TraceError for another root, or more than a tuning holds."""
    if path.stat().st_size > LARGEST_BYTES:
        raise TraceError(f"{path}: more than {LARGEST_BYTES} bytes")
    builder = TreeBuilder()
    elements = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal elements
        elements += 1
        if elements == 1 and tag != TUNING_ROOT and not tag.startswith(MEASUREMENT_ROOT):
            raise TraceError(
                f"{path}: an HTML or XML document <{tag[:40]}>; expected a SINUMERIK auto "
                f"servo tuning <{TUNING_ROOT}> or a measurement <{MEASUREMENT_ROOT}...>"
            )
        if elements > MOST_ELEMENTS:
            raise TraceError(f"{path}: more than {MOST_ELEMENTS} elements")
        builder.start(tag, attributes)

    reader = XmlReader(path, file, start, builder.end, builder.data)
    while reader.feed():
        pass
    return builder.close()


def _of_tuning(root: Element) -> MeasuredResponse:
    """The last plant before a coherence, of those in the list of the speed controllers."""
    plant = coherence = candidate = None
    lists = [each for each in root.iter() if each.get("name") == "m_SpeedControllerList"]
    for each in (each for parent in lists[:1] for each in parent.iter() if each.tag in _RESPONSES):
        if each.get("name") == "m_pPlant":
            candidate = each
            plant = each if plant is None else plant
        elif each.get("name") == "m_pMeasCoherence":
            plant, coherence = candidate, each
    if plant is None:
        raise ValueError("no measured response of the mechanics (m_pPlant); tune the axis first")
    frequency, response = _curve(plant)
    if coherence is None:
        raise ValueError("a response without its coherence (m_pMeasCoherence)")
    at, values = _curve(coherence)
    rotary = [each.text for each in root.iter() if each.get("name") == "m_bMotorIsRotary"]
    linear = bool(rotary) and (rotary[-1] or "").strip() == "false"
    unit = "" if linear else "rad/(s N m)"
    return _checked(root, frequency, response, np.interp(frequency, at, values.real), unit)


def _of_spectra(root: Element) -> MeasuredResponse:
    """G = S_yy / S_uy and |S_uy|^2 / (S_uu S_yy), of a measurement with its spectra.

    Which of the two is conjugated in S_uy no file says: a mass lags behind its torque.
    """
    spectra = list(root.iter("CrossSpectrum"))[:SPECTRA]
    if len(spectra) < SPECTRA:
        raise ValueError(f"{len(spectra)} spectra; expected own, cross and own spectrum")
    curves = [_curve(each) for each in spectra]
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
    return _checked(root, frequency, response, coherence, "")


def _checked(
    root: Element, frequency: Floats, response: Complexes, coherence: Floats, unit: str
) -> MeasuredResponse:
    """The response where it is one. Raises ValueError for a coherence that is none."""
    kept = (frequency > 0.0) & (frequency < LARGEST) & np.isfinite(coherence)
    kept &= (np.abs(response) > 1.0 / LARGEST) & (np.abs(response) < LARGEST)
    if not kept.any():
        raise ValueError("a response without a number")
    if np.any((coherence[kept] < -_ROUNDING) | (coherence[kept] > 1.0 + _ROUNDING)):
        raise ValueError("a coherence that is not between 0 and 1")
    stated: dict[str, float] = {}
    for each in root.iter():
        name = _STATED.get(each.get("name", ""))
        with suppress(ValueError):
            value = float(each.text or "") if name else 0.0
            if name and 0.0 < value < math.inf:  # later ones are of what was tuned from the first
                stated.setdefault(name, value)
    names = [each.text or "" for each in root if each.get("name") == "m_szAxisName"]
    number = stated.get("axis")
    return MeasuredResponse(
        names[-1].strip()[:40] if names else "" if number is None else f"{number:g}",
        frequency[kept],
        response[kept],
        np.clip(coherence[kept], 0.0, 1.0),
        unit,
        stated.get("averages", 1.0),
        {name: each for name, each in stated.items() if name.endswith("kg_m2")},
    )


def _curve(response: Element) -> tuple[Floats, Complexes]:
    """Frequencies and values of a response or spectrum, (n,) each. Raises ValueError."""
    title = response.get("name") or response.tag
    arrays: dict[str, Floats] = {}
    for each in response.iter("NumericArray"):
        name, form, text = each.get("name", ""), each.get("format", ""), each.findtext("raw") or ""
        try:
            if form == "base85":
                arrays[name] = doubles_from_base85(text)
            elif form == "CSV":
                arrays[name] = np.array([float(cell) for cell in text.split(",") if cell.strip()])
            else:
                raise ValueError(f"numbers in the form {form[:20]!r}; expected base85 or CSV")
        except ValueError as error:
            raise ValueError(f"{title} {name}: {error}") from None
    frequency = arrays.get("m_FrequencyVector", np.empty(0))
    values = arrays.get("m_ValueVector", np.empty(0))
    if len(frequency) > MOST_FREQUENCIES:
        raise ValueError(f"more than {MOST_FREQUENCIES} frequencies")
    if not len(frequency) or len(values) != 2 * len(frequency):
        raise ValueError(
            f"{title}: {len(frequency)} frequencies and {len(values) / 2:g} values; "
            "expected as many of both"
        )
    if not np.isfinite(frequency).all() or np.any(np.diff(frequency) <= 0.0):
        raise ValueError(f"{title}: its frequencies do not rise")
    return frequency, values.view(np.complex128)


def doubles_from_base85(text: str) -> Floats:
    """Doubles in a text, white space aside, shape (n,).

    Raises ValueError: one line; a character that is no digit, or no whole number of doubles.
    """
    digits = "".join(text.split()).replace(".", "00000")
    if len(digits) % 10:
        raise ValueError("no whole number of doubles")
    if set(digits) - set(ALPHABET):
        raise ValueError("a character that is no digit of base 85")
    return np.frombuffer(base64.a85decode(digits.translate(_ASCII85)), ">f8").astype(np.float64)
