"""Images from files: 8-bit RGBA for textures, linear float32 for environment maps."""

from __future__ import annotations

import io
import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from clsim.errors import InputError
from clsim.frames.exr_read import read_channels
from clsim.frames.layouts import recognise
from clsim.frames.planes import RADIANCE

if TYPE_CHECKING:
    from PIL import Image

MAX_PIXELS = 1 << 26
"""Largest image that is decoded: its packed size tells nothing about its memory."""
MAX_TOTAL_PIXELS = 1 << 28
U8 = npt.NDArray[np.uint8]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]


class PixelBudget:
    """How many pixels all images of a scene may have together."""

    def __init__(self, pixels: int = MAX_TOTAL_PIXELS) -> None:
        """Start with this many."""
        self.left = pixels

    def take(self, source: str, width: int, height: int) -> None:
        """Take an image's pixels; raises InputError where one image or all are too many."""
        if width * height > MAX_PIXELS:
            raise InputError(f"{source}: is {width}×{height}, expected at most {MAX_PIXELS} pixels")
        self.left -= width * height
        if self.left < 0:
            raise InputError(f"{source}: all images together have more than {MAX_TOTAL_PIXELS} pixels")


def decode_rgba(source: str, data: bytes, budget: PixelBudget) -> U8:
    """Decode PNG, JPEG, WebP, TGA, BMP… to uint8 ``[h, w, 4]``; 16-bit channels are rounded to 8.

    Raises:
        InputError: naming the source, if the image is damaged or too large.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the size is checked where it is unpacked
            image = Image.open(io.BytesIO(data))
    except Exception as error:  # Pillow raises whatever its decoders stumble over
        reason = _short(error)
        if isinstance(error, UnidentifiedImageError):
            known = "expected PNG, JPEG, WebP or another that Pillow reads"
            reason = f"it is {'KTX2' if data[1:7] == b'KTX 20' else 'of no known format'}, {known}"
        raise InputError(f"{source}: cannot be decoded as an image ({reason})") from None
    return unpack_rgba(source, image, budget)


def unpack_rgba(source: str, image: Image.Image, budget: PixelBudget) -> U8:
    """Unpack an image that Pillow has opened, as `decode_rgba` does.

    Raises:
        InputError: naming the source, if the image is damaged or too large.
    """
    from PIL import Image

    budget.take(source, *image.size)
    try:
        if image.mode.startswith(("I", "F")):
            top = 65535.0 if image.mode.startswith("I") else 1.0
            deep = np.asarray(image, np.float64) / top
            image = Image.fromarray(np.clip(deep * 255.0 + 0.5, 0, 255).astype(np.uint8))
        return np.ascontiguousarray(image.convert("RGBA"), np.uint8)
    except Exception as error:  # Pillow raises whatever its decoders stumble over
        raise InputError(f"{source}: cannot be decoded as an image ({_short(error)})") from None


def read_texture(path: Path, budget: PixelBudget, *, srgb: bool = True) -> U8:
    """Read an image file as uint8 RGBA.

    Numbers of OpenEXR and Radiance HDR are sRGB-encoded, or as they are where ``srgb`` is false; what exceeds 1 is cut.

    Raises:
        InputError: if it is missing, damaged or too large.
    """
    if is_linear(path):
        linear = read_linear(path, budget, colours=srgb)
        return _opaque(encode_srgb8(linear) if srgb else np.clip(linear * 255.0 + 0.5, 0, 255).astype(np.uint8))
    return decode_rgba(str(path), _bytes(path), budget)


def read_light(path: Path, budget: PixelBudget) -> tuple[U8, float]:
    """Read OpenEXR or Radiance HDR as the picture of a light: uint8 RGBA with sRGB's curve, and a factor on its light.

    The picture ends at 1, so the factor is the file's largest number, and at least 1.

    Raises:
        InputError: if it is missing, damaged or too large.
    """
    linear = read_linear(path, budget)
    most = max(1.0, float(linear.max()))
    return _opaque(encode_srgb8(linear / most)), most


def is_linear(path: Path | str) -> bool:
    """Tell whether a file of that name holds light itself, without sRGB's curve: OpenEXR and Radiance HDR."""
    return Path(path).suffix.lower() in (".exr", ".hdr")


def _opaque(codes: U8) -> U8:
    return np.concatenate([codes, np.full((*codes.shape[:2], 1), 255, np.uint8)], axis=2)


def read_linear(path: Path, budget: PixelBudget, *, colours: bool = True) -> F32:
    """Read an image as linear float32 ``[h, w, 3]``: OpenEXR and Radiance HDR as they are, others decoded from sRGB.

    Colours are Rec. 709's: those of an OpenEXR file of other primaries are converted, unless ``colours`` is false.

    Raises:
        InputError: if it is missing, damaged, too large, or holds negative or non-finite numbers only.
    """
    suffix = path.suffix.lower()
    if suffix == ".exr":
        pixels = _read_exr(path, budget, colours=colours)
    elif suffix == ".hdr":
        pixels = decode_radiance_hdr(str(path), _bytes(path), budget)
    else:
        rgb = decode_rgba(str(path), _bytes(path), budget)[..., :3]
        table = decode_srgb(np.arange(256) / 255.0).astype(np.float32)
        return np.ascontiguousarray(table[rgb])
    good = np.isfinite(pixels)
    if not good.any():
        raise InputError(f"{path}: has no finite pixel")
    return np.ascontiguousarray(np.where(good, np.maximum(pixels, 0.0), 0.0), np.float32)


def decode_srgb(encoded: npt.ArrayLike) -> F64:
    """Decode sRGB to linear (IEC 61966-2-1)."""
    srgb = np.asarray(encoded, np.float64)
    linear: F64 = np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.04045) + 0.055) / 1.055) ** 2.4)
    return linear


def encode_srgb8(linear: npt.ArrayLike) -> U8:
    """Encode linear light as 8-bit sRGB (IEC 61966-2-1)."""
    value = np.clip(np.asarray(linear, np.float64), 0.0, 1.0)
    srgb = np.where(value <= 0.0031308, value * 12.92, 1.055 * np.maximum(value, 1e-9) ** (1 / 2.4) - 0.055)
    return np.asarray(np.clip(srgb * 255.0 + 0.5, 0, 255), np.uint8)


def roughness_pixels(alpha: npt.ArrayLike) -> U8:
    """Return GGX's α ``[h, w]`` as ``Material.roughness_texture`` wants it: √α in green; blue changes nothing."""
    green = np.clip(np.sqrt(np.clip(alpha, 0.0, 1.0)) * 255.0 + 0.5, 0, 255).astype(np.uint8)
    full = np.full_like(green, 255)
    return np.stack([full, green, full, full], axis=-1)


def decode_radiance_hdr(source: str, data: bytes, budget: PixelBudget) -> F32:
    """Decode Radiance RGBE (Ward, Graphics Gems II, 1991), flat or run-length encoded.

    Raises:
        InputError: naming the source, if it is damaged or too large.
    """
    head, _, rest = data.partition(b"\n\n")
    line, _, body = rest.partition(b"\n")
    words = line.split()
    if not head.startswith((b"#?RADIANCE", b"#?RGBE")) or len(words) != 4 or words[0] != b"-Y" or words[2] != b"+X":
        raise InputError(f"{source}: is not a Radiance HDR image with rows from the top (-Y … +X …)")
    if b"32-bit_rle_xyze" in head or not (words[1].isdigit() and words[3].isdigit()):
        raise InputError(f"{source}: is not an RGBE image of known size")
    height, width = int(words[1][:9]), int(words[3][:9])
    budget.take(source, width, height)
    rgbe = _rgbe_rows(source, body, width, height)
    exponent = np.ldexp(np.float32(1.0), rgbe[..., 3].astype(np.int32) - 136)
    pixels: F32 = np.where(rgbe[..., 3:] > 0, rgbe[..., :3] * exponent[..., None], 0.0).astype(np.float32)
    return pixels


def _rgbe_rows(source: str, body: bytes, width: int, height: int) -> U8:
    truncated = InputError(f"{source}: ends within its pixels: it is truncated")
    if not (8 <= width < 32768 and body[:2] == b"\x02\x02" and not body[2:3] > b"\x7f"):
        if len(body) < width * height * 4:
            raise truncated
        return np.frombuffer(body, np.uint8, width * height * 4).reshape(height, width, 4)
    if len(body) < 4 * height:  # a row has a head of 4 bytes at least
        raise truncated
    rows, at = np.zeros((height, 4, width), np.uint8), 0
    marker = bytes((2, 2, width >> 8, width & 255))
    for y in range(height):
        if body[at : at + 4] != marker:
            raise InputError(f"{source}: row {y} does not start with its length")
        at += 4
        for channel in range(4):
            x = 0
            while x < width:
                if at + 1 >= len(body):
                    raise truncated
                count = body[at]
                run = count > 128
                count = count - 128 if run else count
                if count == 0 or x + count > width or at + 1 + (1 if run else count) > len(body):
                    raise InputError(f"{source}: row {y} has a run of {count} pixels at {x} of {width}")
                stop = at + 2 if run else at + 1 + count
                rows[y, channel, x : x + count] = np.frombuffer(body[at + 1 : stop], np.uint8)
                at, x = stop, x + count
    return np.ascontiguousarray(rows.transpose(0, 2, 1))


def _read_exr(path: Path, budget: PixelBudget, *, colours: bool) -> F32:
    channels, _ = read_channels(path, colours=colours, check_size=partial(budget.take, str(path)))
    names = recognise(channels, str(path)).channels
    return np.stack([channels[names[name]] for name in RADIANCE], axis=-1).astype(np.float32)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
