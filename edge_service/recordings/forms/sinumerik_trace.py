"""The XML of a SINUMERIK "Solution Line Trace"."""

from pathlib import Path

from ..block import Source
from ..sinumerik.controller_axis import ControllerAxis
from ..sinumerik.source import SinumerikSource, is_sinumerik
from .form import Form


def _open(path: Path, axis: ControllerAxis) -> Source:
    return SinumerikSource(path, axis.interpolate_positions)


FORM = Form("SINUMERIK trace XML", lambda head, _path: is_sinumerik(head), _open)
