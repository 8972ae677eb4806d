"""Pictures as other programs write them: tiled TIFF, signs, single bits, mirrors of EXIF, light without a curve."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import PIL.Image
import PIL.ImageOps
import pytest
import tifffile

from clsim.errors import InputError
from clsim.footage.images import Pictures
from clsim.footage.open import open_footage
from clsim.footage.source import Reading
from clsim.frames import RADIANCE, Frame, page_aligned

GREY = (np.arange(20 * 36).reshape(20, 36) * 90).astype(np.uint16)
COLOUR = np.random.default_rng(2).integers(0, 256, (16, 24, 3), np.uint8)


def light(path: Path, transfer: Any = "as-is") -> npt.NDArray[np.float32]:
    source = Pictures(path, Reading(transfer, fps=10.0))
    frame = Frame(page_aligned((3, source.height, source.width)), RADIANCE)
    source.fill(0, frame)
    return frame.planes


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("options", [{"tile": (16, 16)}, {"tile": (64, 64), "compression": "zlib"}, {"bigtiff": True}])
@pytest.mark.parametrize("colour", [False, True])
def test_tiff_in_tiles_is_what_it_shows(tmp_path: Path, kind: type, options: dict[str, Any], colour: bool) -> None:
    """libav makes it black, with a word in its log alone."""
    grey = (GREY >> (0 if kind is np.uint16 else 8)).astype(kind)
    pixels = np.stack([grey, grey // 2, grey // 3], axis=2) if colour else grey
    tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="rgb" if colour else "minisblack", **options)
    source = Pictures(tmp_path / "a.tif", Reading(fps=10.0))
    assert (source.transfer, source.steps) == ("srgb", np.iinfo(kind).max)
    planes = np.moveaxis(pixels, 2, 0) if colour else np.stack([pixels] * 3)
    np.testing.assert_allclose(light(tmp_path / "a.tif"), planes / np.float32(np.iinfo(kind).max))


def test_a_picture_is_one_in_capitals_too(tmp_path: Path) -> None:
    PIL.Image.fromarray(COLOUR).save(tmp_path / "A.PNG")
    assert isinstance(open_footage(str(tmp_path / "A.PNG"), Reading(fps=10.0)), Pictures)


def test_tiff_that_holds_jpeg_is_refused_and_not_black(tmp_path: Path) -> None:
    PIL.Image.fromarray(COLOUR).save(tmp_path / "a.tif", compression="jpeg")
    with pytest.raises(InputError, match=r"a\.tif: "):
        light(tmp_path / "a.tif")


@pytest.mark.parametrize("kind", [np.int8, np.int16, np.uint32])
def test_tiff_of_numbers_with_a_sign_or_of_many_bits_is_refused(tmp_path: Path, kind: type) -> None:
    tifffile.imwrite(tmp_path / "a.tif", (GREY >> 9).astype(kind), tile=(16, 16))
    with pytest.raises(InputError, match=r"a\.tif: .* expected grey or RGB of 8 or 16 bits without a sign"):
        light(tmp_path / "a.tif")


def test_tiff_of_luma_and_chroma_has_full_range_and_the_matrix_of_jpeg(tmp_path: Path) -> None:
    """TIFF 6.0, section 21: ReferenceBlackWhite is [0, 255, 128, 255, 128, 255] unless told."""
    tall = np.zeros((600, 8, 3), np.uint8) + np.uint8([200, 40, 60])
    PIL.Image.fromarray(tall).convert("YCbCr").save(tmp_path / "a.tif")
    np.testing.assert_allclose(light(tmp_path / "a.tif"), np.moveaxis(tall, 2, 0) / 255, atol=0.01)


@pytest.mark.parametrize("ending", ["png", "tif", "pgm"])
def test_pictures_of_single_bits_are_black_and_white(tmp_path: Path, ending: str) -> None:
    bits = COLOUR[..., 0] > 128
    PIL.Image.fromarray(bits).save(tmp_path / f"a.{ending}")
    np.testing.assert_array_equal(light(tmp_path / f"a.{ending}"), np.stack([bits] * 3))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("ending", ["jpg", "png", "webp", "tif"])
def test_pictures_are_mirrored_as_exif_says(tmp_path: Path, ending: str, orientation: int) -> None:
    exif = PIL.Image.Exif()
    exif[0x112] = orientation
    smooth = np.kron(COLOUR[::8, ::8], np.ones((8, 8, 1), np.uint8))
    more: dict[str, Any] = {"jpg": {"quality": 100, "subsampling": 0}, "webp": {"lossless": True}}.get(ending, {})
    PIL.Image.fromarray(smooth).save(tmp_path / f"a.{ending}", exif=exif, **more)
    upright = PIL.ImageOps.exif_transpose(PIL.Image.open(tmp_path / f"a.{ending}").convert("RGB"))
    found = light(tmp_path / f"a.{ending}")
    np.testing.assert_allclose(found, np.moveaxis(np.array(upright), 2, 0) / 255, atol=0.03)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_tiff_of_floating_point_lies_as_its_tag_says(tmp_path: Path, orientation: int) -> None:
    image = PIL.Image.fromarray(GREY.astype(np.float32))
    tags = [(0x112, 3, 1, orientation, True)]
    tifffile.imwrite(tmp_path / "a.tif", np.array(image), extratags=tags)
    image.getexif()[0x112] = orientation
    np.testing.assert_array_equal(light(tmp_path / "a.tif")[0], np.array(PIL.ImageOps.exif_transpose(image)))


@pytest.mark.parametrize(
    ("told", "curve"),
    [((b"gAMA", struct.pack(">I", 100_000)), "linear"), ((b"cICP", bytes([1, 8, 0, 1])), "linear"),
     ((b"gAMA", struct.pack(">I", 45_455)), "srgb"), ((b"sRGB", b"\0"), "srgb")],
)  # fmt: skip
def test_a_png_that_says_that_it_holds_light_holds_light(tmp_path: Path, told: tuple[bytes, bytes], curve: str) -> None:
    """PNG (third edition), 11.3.2: a gAMA of 1, or 8 in cICP (H.273), is no curve at all."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in GREY)
    parts = ((b"IHDR", struct.pack(">IIBBBBB", 36, 20, 16, 0, 0, 0, 0)), told, (b"IDAT", zlib.compress(rows)))
    data = b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in (*parts, (b"IEND", b"")))
    (tmp_path / "a.png").write_bytes(data)
    assert Pictures(tmp_path / "a.png", Reading(fps=10.0)).transfer == curve


@pytest.mark.parametrize("options", [{}, {"tile": (16, 16)}, {"photometric": "rgb", "planarconfig": "separate"}])
def test_tiff_with_any_wrong_byte_is_a_picture_or_a_sentence(tmp_path: Path, options: dict[str, Any]) -> None:
    pixels = np.ones((3, 8, 8) if "photometric" in options else (8, 8), np.float32)
    tifffile.imwrite(tmp_path / "a.tif", pixels, **options)
    data = (tmp_path / "a.tif").read_bytes()
    for at in range(300):
        (tmp_path / "b.tif").write_bytes(data[:at] + bytes([data[at] ^ 255]) + data[at + 1 :])
        try:
            found = light(tmp_path / "b.tif")
        except InputError as error:
            assert "b.tif" in str(error) and "\n" not in str(error)
        else:
            assert found.ndim == 3


@pytest.mark.parametrize("pages", [1, 2])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_a_folder_of_tiff_with_several_pages_each_is_told(tmp_path: Path, pages: int, kind: type) -> None:
    for k in range(2):
        tifffile.imwrite(tmp_path / f"{k}.tif", np.zeros((pages, 20, 36), kind), photometric="minisblack")
    told = (f"{tmp_path / '0.tif'} holds {pages} pages, of which the first is read",) if pages > 1 else ()
    assert Pictures(tmp_path, Reading(fps=10.0)).warnings == told
