"""Images: 8-bit for textures, linear for environment maps."""

import numpy as np
import OpenEXR
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene.pictures.images import (
    PixelBudget,
    decode_radiance_hdr,
    decode_srgb,
    encode_srgb8,
    read_linear,
    read_texture,
)


def rgbe(pixels, *, packed):
    """Write Radiance HDR as its format says, flat or run-length encoded."""
    h, w, _ = pixels.shape
    exponent = np.ceil(np.log2(np.maximum(pixels.max(axis=2), 1e-30))).astype(int)
    mantissa = np.clip(np.floor(pixels * 256 / 2.0 ** exponent[..., None]), 0, 255).astype(np.uint8)
    rows = np.concatenate([mantissa, (exponent + 128).astype(np.uint8)[..., None]], axis=2)
    data = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {h} +X {w}\n".encode()
    if not packed:
        return data + rows.tobytes()
    for row in rows:
        data += bytes((2, 2, w >> 8, w & 255))
        for channel in row.T:
            half = w // 2
            data += (
                bytes((128 + half, channel[0]))
                if (channel[:half] == channel[0]).all()
                else bytes((half,)) + channel[:half].tobytes()
            )
            data += bytes((w - half,)) + channel[half:].tobytes()
    return data


@pytest.mark.parametrize("packed", [False, True])
def test_radiance_hdr_is_read_to_its_precision(tmp_path, packed):
    pixels = np.random.default_rng(0).uniform(0.01, 50, (5, 16, 3))
    pixels[:, :8] = (3.0, 0.5, 1.0)
    path = tmp_path / "a.hdr"
    path.write_bytes(rgbe(pixels, packed=packed))
    found = read_linear(path, PixelBudget())
    assert (np.abs(found - pixels) <= pixels.max(axis=2, keepdims=True) / 128).all()
    whole = path.read_bytes()
    for cut in (0, 5, 40, len(whole) - 3):
        with pytest.raises(InputError, match=r"x\.hdr"):
            decode_radiance_hdr("x.hdr", whole[:cut], PixelBudget())


def test_radiance_hdr_of_xyz_is_refused(tmp_path):
    data = b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n" + bytes([128, 128, 128, 129])
    (tmp_path / "a.hdr").write_bytes(data)
    with pytest.raises(InputError, match="is not an RGBE image of known size"):
        read_linear(tmp_path / "a.hdr", PixelBudget())


def test_openexr_is_read_with_negative_and_infinite_pixels_removed(tmp_path):
    pixels = np.random.default_rng(1).uniform(0, 9, (4, 6, 3)).astype(np.float32)
    pixels[0, 0], pixels[1, 1, 2] = (np.inf, np.nan, -1), -3
    path = tmp_path / "a.exr"
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"RGB": pixels}) as file:
        file.write(str(path))
    expected = pixels.copy()
    expected[0, 0], expected[1, 1, 2] = 0, 0
    np.testing.assert_array_equal(read_linear(path, PixelBudget()), expected)
    assert read_texture(path, PixelBudget()).shape == (4, 6, 4)
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InputError, match=r"a\.exr"):
        read_linear(path, PixelBudget())


def test_srgb_there_and_back():
    codes = np.arange(256)
    np.testing.assert_array_equal(encode_srgb8(decode_srgb(codes / 255)), codes)
    assert decode_srgb(0.5) == pytest.approx(0.21404114)


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGB", "RGBA", "I;16", "1"])
def test_every_kind_of_png_becomes_rgba(tmp_path, mode):
    path = tmp_path / "a.png"
    if mode == "I;16":
        PIL.Image.fromarray(np.array([[0, 65535], [32768, 257]], np.uint16)).save(path)
        expected = [[0, 255], [128, 1]]
    else:
        source = PIL.Image.fromarray(np.array([[0, 255], [255, 0]], np.uint8))
        source.convert(mode).save(path)
        expected = [[0, 255], [255, 0]]
    pixels = read_texture(path, PixelBudget())
    assert pixels.dtype == np.uint8
    np.testing.assert_array_equal(pixels[..., 1], expected)
    np.testing.assert_array_equal(pixels[..., 3], 255)


def test_all_images_share_one_budget(tmp_path):
    path = tmp_path / "a.png"
    PIL.Image.fromarray(np.zeros((10, 10), np.uint8)).save(path)
    budget = PixelBudget(150)
    read_texture(path, budget)
    with pytest.raises(InputError, match="all images together"):
        read_texture(path, budget)
    for content, part in ((b"", "cannot be decoded"), (path.read_bytes()[:30], "cannot be decoded")):
        path.write_bytes(content)
        with pytest.raises(InputError, match=part):
            read_texture(path, PixelBudget())
    with pytest.raises(InputError, match="cannot be read"):
        read_texture(tmp_path / "none.png", PixelBudget())


@pytest.mark.parametrize(("kind", "top"), [(np.float32, 1), (np.uint16, 65535), (np.uint8, 255)])
def test_a_tiff_has_its_light_whatever_its_numbers_are(tmp_path, kind, top):
    shares = np.array([[0.0, 0.2, 1.0]])
    PIL.Image.fromarray((shares * top).astype(kind)).save(tmp_path / "a.tif")
    pixels = read_texture(tmp_path / "a.tif", PixelBudget())
    np.testing.assert_array_equal(pixels[..., 0], [[0, 51, 255]])


@pytest.mark.parametrize("width", [1, 2, 7, 8, 9, 127, 128, 200, 254])
def test_radiance_hdr_of_any_width_is_read(width):
    """Rows of 8 pixels and more may be packed; narrower ones never are."""
    pixels = np.random.default_rng(width).uniform(0.01, 50, (3, width, 3))
    flat = decode_radiance_hdr("a.hdr", rgbe(pixels, packed=False), PixelBudget())
    assert (np.abs(flat - pixels) <= pixels.max(axis=2, keepdims=True) / 128).all()
    if width >= 8:
        np.testing.assert_array_equal(decode_radiance_hdr("a.hdr", rgbe(pixels, packed=True), PixelBudget()), flat)
