"""The XML of SINUMERIK's servo tuning, read once in bounded memory."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO
from xml.parsers import expat

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats
from ..columns import TraceError
from .base85 import doubles_from_base85
from .parser import CHUNK_BYTES, text_decoder

TUNING_ROOT, MEASUREMENT_ROOT = "DynamicModelAxisController", "ResponseTest"
MOST_FREQUENCIES = 1 << 17
LONGEST_TEXT = 1 << 23
DEEPEST = 64
SPECTRA = 3
_SPECTRUM = "CrossSpectrum"
_RESPONSES = {"FrequencyResponseFunction", _SPECTRUM}
_STATED = {
    "m_dMotorInertia": "motor_inertia_kg_m2",
    "m_dTotalInertia": "total_inertia_kg_m2",
    "m_uNumberOfAverages": "averages",
    "m_uAxis": "axis",
}

Complexes = npt.NDArray[np.complex128]


@dataclass(slots=True)
class RawResponse:
    """One response or spectrum of the file, as far as it is read."""

    name: str
    mechanics: bool
    spectrum: bool
    arrays: dict[str, Floats] = field(default_factory=dict)

    def curve(self) -> tuple[Floats, Complexes]:
        """Frequencies and values, (n,) each. Raises ValueError."""
        frequency = self.arrays.get("m_FrequencyVector", np.empty(0))
        values = self.arrays.get("m_ValueVector", np.empty(0))
        if not len(frequency) or len(values) != 2 * len(frequency):
            raise ValueError(
                f"{self.name}: {len(frequency)} frequencies and {len(values) / 2:g} values; "
                "expected as many of both"
            )
        if not np.isfinite(frequency).all() or np.any(np.diff(frequency) <= 0.0):
            raise ValueError(f"{self.name}: its frequencies do not rise")
        return frequency, values.view(np.complex128)


class TuningParser:
    """Reads a file once, in bounded memory; a document type, and with it entities, is refused."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.path = path
        self.root = ""
        self.axis_name = ""
        self.rotary = True
        self.stated: dict[str, float] = {}
        self.plant: RawResponse | None = None
        self.coherence: RawResponse | None = None
        self.spectra: list[RawResponse] = []
        self._candidate: RawResponse | None = None
        self._stack: list[tuple[str, str]] = []
        self._response: RawResponse | None = None
        self._format = ""
        self._text: list[str] = []
        self._text_size = 0
        self._parser = expat.ParserCreate("utf-8")
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._characters
        self._parser.StartDoctypeDeclHandler = self._refuse_document_type
        self._parser.EntityDeclHandler = self._refuse_document_type
        self._parse(file)

    def _parse(self, file: BinaryIO) -> None:
        raw = file.read(CHUNK_BYTES)
        decoder = text_decoder(self.path, raw)
        try:
            while True:
                self._parser.Parse(decoder.decode(raw, not raw).encode(), not raw)
                if not raw:
                    return
                raw = file.read(CHUNK_BYTES)
        except expat.ExpatError as error:
            raise TraceError(
                f"{self.path}: line {error.lineno}: cut off or damaged "
                f"({expat.ErrorString(error.code)})"
            ) from None

    def _refuse_document_type(self, *_: object) -> None:
        raise TraceError(f"{self.path}: declares a document type or entities; refused")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self._stack:
            self._check_root(tag)
        if len(self._stack) >= DEEPEST:
            raise TraceError(f"{self.path}: elements more than {DEEPEST} deep")
        name = attributes.get("name", "")
        self._text, self._text_size = [], 0
        if tag in _RESPONSES:
            inside = any(each == "m_SpeedControllerList" for _, each in self._stack)
            self._response = RawResponse(name or tag, inside, tag == _SPECTRUM)
        elif tag == "NumericArray":
            self._format = attributes.get("format", "")
        self._stack.append((tag, name))

    def _check_root(self, tag: str) -> None:
        self.root = tag
        if tag != TUNING_ROOT and not tag.startswith(MEASUREMENT_ROOT):
            raise TraceError(
                f"{self.path}: an HTML or XML document <{tag[:40]}>; expected a SINUMERIK auto "
                f"servo tuning <{TUNING_ROOT}> or a measurement <{MEASUREMENT_ROOT}...>"
            )

    def _characters(self, text: str) -> None:
        self._text_size += len(text)
        if self._text_size > LONGEST_TEXT:
            raise TraceError(f"{self.path}: an element of more than {LONGEST_TEXT} characters")
        self._text.append(text)

    def _end(self, tag: str) -> None:
        name = self._stack.pop()[1]
        text = "".join(self._text).strip()
        self._text = []
        if tag == "raw" and self._response is not None and self._stack:
            self._read_array(self._response, self._stack[-1][1], text)
        elif tag in _RESPONSES and self._response is not None:
            self._keep(self._response)
            self._response = None
        elif name == "m_szAxisName" and len(self._stack) == 1:
            self.axis_name = text[:40]
        elif name == "m_bMotorIsRotary":
            self.rotary = text != "false"
        elif name in _STATED:
            self._state(_STATED[name], text)

    def _state(self, name: str, text: str) -> None:
        """Keep the first number above 0: later ones belong to what was tuned from it."""
        try:
            value = float(text)
        except ValueError:
            return
        if math.isfinite(value) and value > 0.0:
            self.stated.setdefault(name, value)

    def _read_array(self, response: RawResponse, name: str, text: str) -> None:
        try:
            values = _numbers(self._format, text)
        except ValueError as error:
            raise TraceError(f"{self.path}: {response.name} {name}: {error}") from None
        if len(values) > 2 * MOST_FREQUENCIES:
            raise TraceError(f"{self.path}: more than {MOST_FREQUENCIES} frequencies")
        response.arrays[name] = values

    def _keep(self, response: RawResponse) -> None:
        if response.name == "m_pPlant" and response.mechanics:
            self._candidate = response
            self.plant = self.plant or response
        elif response.name == "m_pMeasCoherence" and response.mechanics:
            self.plant, self.coherence = self._candidate, response
        elif response.spectrum and len(self.spectra) < SPECTRA:
            self.spectra.append(response)


def _numbers(form: str, text: str) -> Floats:
    if form == "base85":
        return doubles_from_base85(text)
    if form == "CSV":
        return np.array([float(cell) for cell in text.split(",") if cell.strip()], dtype=np.float64)
    raise ValueError(f"numbers in the form {form[:20]!r}; expected base85 or CSV")
