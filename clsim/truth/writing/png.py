"""PNG images of 8 and 16 bits, grey and colour: Pillow keeps 8 bits of a colour at most.

Source: PNG (Portable Network Graphics) Specification, third edition, W3C 2025.
"""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_UP = 2
_GREY, _RGB = 0, 2
_LARGEST_SIDE = 1 << 16
_MOST_BYTES = 1 << 30


def write_png(path: Path, image: npt.NDArray[Any]) -> None:
    """Write uint8 or uint16 ``[H, W]`` or ``[H, W, 3]``; the file appears under its name when it is complete."""
    height, width = image.shape[:2]
    big_endian = np.ascontiguousarray(image.astype(image.dtype.newbyteorder(">")))
    rows = big_endian.view(np.uint8).reshape(height, -1)
    filtered = np.empty((height, 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = _UP
    filtered[0, 1:] = rows[0]
    filtered[1:, 1:] = rows[1:] - rows[:-1]
    colour = _RGB if image.ndim == 3 else _GREY
    header = struct.pack(">IIBBBBB", width, height, 8 * image.dtype.itemsize, colour, 0, 0, 0)
    part = path.with_name(f".{path.name}.part")
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(filtered.tobytes(), 1)), (b"IEND", b""))
    part.write_bytes(_SIGNATURE + b"".join(_chunk(kind, data) for kind, data in chunks))
    os.replace(part, path)


def read_png(path: Path) -> npt.NDArray[Any]:
    """Read uint8 or uint16 ``[H, W]`` or ``[H, W, 3]``.

    Raises:
        InputError: the file cannot be read, is damaged, or is of another kind (palettes, transparency, interlacing).
    """
    try:
        return _decode(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, struct.error, zlib.error) as error:
        raise InputError(f"{path}: is no PNG that can be read here ({error})") from None


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _decode(data: bytes) -> npt.NDArray[Any]:
    if not data.startswith(_SIGNATURE):
        raise ValueError("it does not begin as one")
    place, header, packed = len(_SIGNATURE), b"", []
    while place < len(data):
        size, kind = struct.unpack_from(">I4s", data, place)
        body = data[place + 8 : place + 8 + size]
        if len(body) < size:
            raise ValueError("it is cut off")
        if kind == b"IHDR":
            header = body
        elif kind == b"IDAT":
            packed.append(body)
        place += 12 + size
    width, height, bits, colour, _, _, interlaced = struct.unpack(">IIBBBBB", header)
    if bits not in (8, 16) or colour not in (_GREY, _RGB) or interlaced:
        raise ValueError(f"{bits} bits, colour type {colour}{', interlaced' if interlaced else ''}")
    channels = 3 if colour == _RGB else 1
    stride = width * channels * bits // 8
    if not (0 < width <= _LARGEST_SIDE and 0 < height <= _LARGEST_SIDE and height * (1 + stride) <= _MOST_BYTES):
        raise ValueError(f"{width}x{height} pixels")
    raw = zlib.decompressobj().decompress(b"".join(packed), height * (1 + stride))
    if len(raw) < height * (1 + stride):
        raise ValueError("it has too few pixels")
    rows = np.frombuffer(raw, np.uint8).reshape(height, 1 + stride)
    pixels = _unfiltered(rows[:, 0], rows[:, 1:].copy(), channels * bits // 8)
    image: npt.NDArray[Any] = pixels.view(">u2").astype(np.uint16) if bits == 16 else pixels
    return image.reshape(height, width, 3) if channels == 3 else image


def _unfiltered(filters: npt.NDArray[np.uint8], rows: npt.NDArray[np.uint8], step: int) -> npt.NDArray[np.uint8]:
    """Undo the filters, row by row; ``step`` is the bytes of a pixel."""
    above = np.zeros(rows.shape[1], np.uint8)
    for kind, row in zip(filters.tolist(), rows, strict=True):
        if kind == 1:
            row[:] = np.cumsum(row.reshape(-1, step), axis=0, dtype=np.uint8).ravel()
        elif kind == _UP:
            row += above
        elif kind in (3, 4):
            _undo_by_pixel(row, above, step, paeth=kind == 4)
        elif kind != 0:
            raise ValueError(f"filter {kind}")
        above = row
    return rows


def _undo_by_pixel(row: npt.NDArray[np.uint8], above: npt.NDArray[np.uint8], step: int, *, paeth: bool) -> None:
    """Undo the filters whose pixels hang on those before them: there is no other way than one after the other."""
    now, up = row.reshape(-1, step).astype(np.int64), above.reshape(-1, step).astype(np.int64)
    left, corner = np.zeros(step, np.int64), np.zeros(step, np.int64)
    for k in range(len(now)):
        if paeth:
            guess = left + up[k] - corner
            to_left, to_up, to_corner = abs(guess - left), abs(guess - up[k]), abs(guess - corner)
            nearest = np.where(to_up <= to_corner, up[k], corner)
            nearest = np.where((to_left <= to_up) & (to_left <= to_corner), left, nearest)
        else:
            nearest = (left + up[k]) // 2
        left = now[k] = (now[k] + nearest) & 0xFF
        corner = up[k]
    row[:] = now.astype(np.uint8).ravel()
