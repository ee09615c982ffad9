"""Cut off what only debuggers read of the libraries in a folder: `python deploy/strip.py FOLDER`.

Symbols and the table of sections stand behind all that is loaded, in 64-bit little-endian ELF. It
needs no tools for compilers, which a computer beside a machine does not have.
"""

import struct
import sys
from pathlib import Path

HEADER = struct.Struct("<16sHHIQQQIHHHHHH")
SEGMENT = struct.Struct("<IIQQQQQQ")
IDENTITY = b"\x7fELF\x02\x01"


def strip(path: Path) -> None:
    """Shorten a library to the last byte of a segment that is loaded; leave other files alone."""
    with path.open("r+b") as file:
        start = file.read(HEADER.size)
        if not start.startswith(IDENTITY):
            return
        header = HEADER.unpack(start)
        place, size, count = header[5], header[9], header[10]
        end = place + size * count
        for number in range(count):
            file.seek(place + size * number)
            segment = SEGMENT.unpack(file.read(SEGMENT.size))
            end = max(end, segment[2] + segment[5])
        file.seek(0)
        file.write(HEADER.pack(*header[:6], 0, *header[7:11], 0, 0, 0))
        file.truncate(end)


if __name__ == "__main__":
    for each in Path(sys.argv[1]).rglob("*.so*"):
        if each.is_file() and not each.is_symlink():
            strip(each)
