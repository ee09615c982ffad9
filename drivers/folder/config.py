"""Settings of a watched folder."""

from pathlib import Path

from pydantic import Field

from ..base import DriverConfig


class FolderConfig(DriverConfig):
    """Settings of a watched folder.

    Attributes:
        folder: where traces appear: CSV, Parquet, SINUMERIK trace XML.
        pattern: of their names.
        axis_number: the controller's number of the axis, in place of the machine file's.
        settle_s: a file that has not changed for so long, and has its proper end, is complete.
        poll_s: between two looks into the folder.
        frame_s: recorded time per frame.
        ledger: file in which is written what has been read; in the folder unless given.
    """

    folder: Path
    pattern: str = Field("*", min_length=1)
    axis_number: int | None = Field(None, ge=1)
    settle_s: float = Field(2.0, ge=0.0, le=3600.0)
    poll_s: float = Field(1.0, gt=0.0, le=3600.0)
    frame_s: float = Field(0.1, ge=0.001, le=1.0)
    ledger: Path | None = None
