"""A decoded video frame or picture becomes linear light: bit depth, range, matrix, transfer function, primaries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.footage import Transfer
from clsim.footage.transfer import decode
from clsim.frames.frame import FloatArray
from clsim.frames.primaries import to_rec709

# Numbers of ITU-T H.273, as libav has them.
_LIMITED, _FULL = 1, 2
_UNSPECIFIED = (0, 2)  # of matrices, 0 means RGB
_BT2020 = 9
_WEIGHTS = {
    1: (0.2126, 0.0722),  # BT.709
    4: (0.30, 0.11),  # FCC
    5: (0.299, 0.114),  # BT.470BG, which JPEG has too
    6: (0.299, 0.114),  # SMPTE 170M
    7: (0.212, 0.087),  # SMPTE 240M
    _BT2020: (0.2627, 0.0593),
}
"""Weights of red and blue in luma, for each matrix."""
_TRANSFERS: dict[int, Transfer] = {
    1: "bt709", 6: "bt709", 7: "bt709", 14: "bt709", 15: "bt709", 8: "linear", 13: "srgb", 16: "pq", 18: "hlg",
}  # fmt: skip
TOLD_OF_PICTURES = ("pq", "hlg", "linear")
"""Those that pictures tell of themselves; what else libav tells of them is a guess of its decoders."""
_709_OF_2020 = np.array(
    [[1.660491, -0.587641, -0.072850], [-0.124550, 1.132900, -0.008349], [-0.018151, -0.100579, 1.118730]], np.float32
)
"""Linear BT.2020 to linear Rec. 709 (ITU-R BT.2087)."""
_DISPLAY_P3 = (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.3290)
_TO_709 = {_BT2020: _709_OF_2020, 12: to_rec709(_DISPLAY_P3)}
"""Matrices to linear Rec. 709 by H.273's numbers of primaries; others are taken for Rec. 709's."""


@dataclass(frozen=True)
class PixelFormat:
    """How the frames of a stream store colour.

    Attributes:
        name: libav's name of the pixel format.
        steps: steps from black to white; None for floating point.
        full: whether codes go from 0 to the largest (full range), rather than 16 to 235 in 8 bits.
        weights: weights of red and blue in luma; None where frames are grey or RGB.
        transfer: the transfer function that the stream tells; None where it tells none that is known.
        primaries: H.273's number of them.
    """

    name: str
    steps: int | None
    full: bool
    weights: tuple[float, float] | None
    transfer: Transfer | None
    primaries: int


def pixel_format(frame: Any, where: str, *, is_picture: bool = False) -> PixelFormat:
    """Return how a decoded frame (of PyAV) stores colour.

    What a stream does not tell follows from customs: luma and chroma have limited range, grey and RGB full; the matrix
    is that of BT.601 up to 576 rows, above it that of BT.709. Pictures have full range and BT.601's, as JPEG has.

    Raises:
        InputError: the layout or the colour matrix is none of those known; ``where`` names the file.
    """
    kind = frame.format
    if kind.name.startswith("xyz") or "msb" in kind.name:
        raise InputError(f"{where}: stores pixels as {kind.name}, expected grey, RGB, or luma and chroma")
    colour = len(kind.components) >= 3 and not kind.is_rgb and not kind.has_palette
    floats = "f16" in kind.name or "f32" in kind.name
    bits = 8 if kind.has_palette else max(c.bits for c in kind.components)
    range_ = int(frame.color_range)
    full = range_ == _FULL or kind.name.startswith("yuvj") or bits < 8
    full = full or (range_ != _LIMITED and (is_picture or not colour))
    primaries = int(frame.color_primaries)
    weights = None
    if colour:
        matrix = int(frame.colorspace)
        if matrix in _UNSPECIFIED:
            matrix = _BT2020 if primaries == _BT2020 else 1 if frame.height > 576 and not is_picture else 6
        weights = _WEIGHTS.get(matrix)
        if weights is None:
            raise InputError(f"{where}: has the colour matrix {frame.colorspace}, expected BT.601, 709 or 2020 (NCL)")
    steps = None if floats else (1 << bits) - 1 if full else 219 << (bits - 8)
    return PixelFormat(kind.name, steps, full, weights, _TRANSFERS.get(int(frame.color_trc)), primaries)


def to_light(frame: Any, kind: PixelFormat, transfer: Transfer, out_rgb: FloatArray) -> None:
    """Write a decoded frame as linear Rec. 709 light ``[3, H, W]``; ``as-is`` keeps stored values and primaries."""
    if _store(frame, kind, out_rgb):  # decoded once for three
        decode(out_rgb[0], transfer)
        out_rgb[1:] = out_rgb[0]
        return
    decode(out_rgb, transfer)
    matrix = _TO_709.get(kind.primaries)
    if matrix is not None and transfer != "as-is":
        # Colours outside Rec. 709 get negative parts; luminance is right all the same.
        out_rgb[...] = np.tensordot(matrix, out_rgb, 1)


def _store(frame: Any, kind: PixelFormat, out_rgb: FloatArray) -> bool:
    """Store RGB as values from 0 to 1, more or less; of grey only the first plane, and return True."""
    if kind.weights is not None:
        _store_luma(frame, kind, kind.weights, out_rgb)
        return False
    bits = max(c.bits for c in frame.format.components)
    alpha = frame.format.name.startswith("ya")
    grey = alpha or (len(frame.format.components) == 1 and not frame.format.has_palette)
    if alpha or bits == 1:
        frame = _as(frame, format="gray" if bits <= 8 else "gray16le")
    elif not grey and kind.steps is not None and not frame.format.name.startswith("gbrp"):
        frame = _as(frame, format="rgb24" if bits <= 8 else "rgb48le")
    # Floating point is taken as it is: a conversion would cut highlights.
    pixels = frame.to_ndarray()
    bits = max(c.bits for c in frame.format.components)
    black, white = _black_and_white(bits, full=kind.full) if kind.steps is not None else (0, 1)
    if grey:
        np.subtract(pixels, np.float32(black), out=out_rgb[0], casting="unsafe")
        out_rgb[0] /= np.float32(white - black)
        return True
    for channel in range(3):
        np.subtract(pixels[..., channel], np.float32(black), out=out_rgb[channel], casting="unsafe")
    out_rgb /= np.float32(white - black)
    return False


def _black_and_white(bits: int, *, full: bool) -> tuple[int, int]:
    """Return the codes of black and white in so many bits."""
    return (0, (1 << bits) - 1) if full else (16 << (bits - 8), 235 << (bits - 8))


def _store_luma(frame: Any, kind: PixelFormat, weights: tuple[float, float], out_rgb: FloatArray) -> None:
    """Store the RGB of luma and chroma."""
    planar = frame if len(frame.planes) >= 3 else _planar(frame)
    bits = max(c.bits for c in planar.format.components)
    unit = 1 << (bits - 8)
    black, white = _black_and_white(bits, full=kind.full)
    luma = (_samples(planar, 0) - np.float32(black)) / np.float32(white - black)
    chroma_span = white if kind.full else 224 * unit
    height, width = luma.shape
    cb, cr = (
        _spread((_samples(planar, k) - np.float32(128 * unit)) / np.float32(chroma_span), height, width) for k in (1, 2)
    )
    red, blue = weights
    green = 1 - red - blue
    out_rgb[0] = luma + np.float32(2 * (1 - red)) * cr
    out_rgb[2] = luma + np.float32(2 * (1 - blue)) * cb
    out_rgb[1] = luma - np.float32(2 * blue * (1 - blue) / green) * cb - np.float32(2 * red * (1 - red) / green) * cr


def _planar(frame: Any) -> Any:
    """Return a frame of interleaved luma and chroma as one of separate planes, its values untouched."""
    parts = frame.format.components
    bits = max(c.bits for c in parts)
    halves = (parts[1].width < frame.width, parts[1].height < frame.height)
    name = {(True, True): "yuv420p", (True, False): "yuv422p", (False, False): "yuv444p"}[halves]
    name += "" if bits == 8 else f"{bits}le"
    return _as(frame, format=name, src_color_range=_FULL, dst_color_range=_FULL)


def _as(frame: Any, **wanted: Any) -> Any:
    """Return a frame in another format, by one thread: of several, one gets rows of P010 wrong, in one of 5,000 frames.

    Older PyAV has no such choice.
    """
    try:
        return frame.reformat(**wanted, threads=1)
    except TypeError:
        return frame.reformat(**wanted)


def _samples(frame: Any, index: int) -> npt.NDArray[np.float32]:
    """Return one plane of a planar frame as numbers ``[h, w]``."""
    plane = frame.planes[index]
    name = frame.format.name
    kind = np.dtype("u1") if max(c.bits for c in frame.format.components) == 8 else np.dtype("<u2")
    if name.endswith("be"):
        kind = kind.newbyteorder(">")
    rows = np.frombuffer(plane, kind).reshape(plane.height, -1)
    return rows[:, : plane.width].astype(np.float32)


def _spread(chroma: npt.NDArray[np.float32], height: int, width: int) -> npt.NDArray[np.float32]:
    """Give each pixel the chroma sample that it shares."""
    down, across = -(-height // chroma.shape[0]), -(-width // chroma.shape[1])
    if (down, across) != (1, 1):
        chroma = np.repeat(np.repeat(chroma, down, axis=0), across, axis=1)
    return chroma[:height, :width]
