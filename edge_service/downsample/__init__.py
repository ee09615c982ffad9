"""Native rate in, one block of sufficient statistics per interval out. Pure."""

from .downsampler import Downsampler
from .statistics import DownsampleSettings

__all__ = ["DownsampleSettings", "Downsampler"]
