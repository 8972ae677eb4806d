"""Zip files as other programs may pack them, and Python's cannot read."""

from pathlib import Path


def repack(path: Path, method: int, flags: int) -> None:
    """Say of all that a zip holds that it is packed by that method, with these flags (APPNOTE 4.3.7 and 4.3.12)."""
    data = bytearray(path.read_bytes())
    for mark, first in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        at = data.find(mark)
        while at >= 0:
            data[at + first : at + first + 4] = flags.to_bytes(2, "little") + method.to_bytes(2, "little")
            at = data.find(mark, at + 4)
    path.write_bytes(data)
