"""Bit depths, ranges, matrices and primaries of decoded frames."""

from __future__ import annotations

import av
import numpy as np
import pytest

from clsim.errors import InputError
from clsim.footage.images import Pictures
from clsim.footage.pixels import pixel_format, to_light
from clsim.footage.source import Reading
from clsim.footage.video import Video
from clsim.frames import RADIANCE, Frame, page_aligned
from tests.footage.clips import encode, frame_of, write_clip

# 75 % colour bars of BT.709 in limited range, 8 bits, as ITU-R BT.1729 and test generators have them.
_BARS = {"white": (180, 128, 128), "red": (51, 109, 212), "green": (133, 63, 52), "blue": (28, 212, 120)}
_COLOURS = {"white": (1, 1, 1), "red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1)}


def first(source):
    frame = Frame(page_aligned((3, source.height, source.width)), RADIANCE)
    source.fill(0, frame)
    source.close()
    return frame.planes


def flat(value, shape=(8, 16), dtype=np.uint8):
    return np.full(shape, value, dtype)


@pytest.mark.parametrize("colour", _BARS)
def test_colour_bars_of_bt709(tmp_path, colour):
    y, cb, cr = _BARS[colour]
    planes = (flat(y), flat(cb, (4, 8)), flat(cr, (4, 8)))
    path = write_clip(tmp_path / "a.mkv", [planes], [0], pixels="yuv420p", matrix=1, limited=True)
    rgb = first(Video(path, Reading("as-is")))
    np.testing.assert_allclose(rgb.mean(axis=(1, 2)), 0.75 * np.array(_COLOURS[colour]), atol=0.006)


@pytest.mark.parametrize(
    ("pixels", "limited", "black", "white", "dtype"),
    [
        ("yuv420p", True, 16, 235, np.uint8),
        ("yuv420p", False, 0, 255, np.uint8),
        ("gray", True, 16, 235, np.uint8),
        ("gray", False, 0, 255, np.uint8),
        ("yuv420p10le", True, 64, 940, np.uint16),
        ("yuv420p10le", False, 0, 1023, np.uint16),
    ],
)
def test_ranges(tmp_path, pixels, limited, black, white, dtype):
    bits = 10 if "10" in pixels else 8
    luma = flat(black, dtype=dtype)
    luma[:, 8:] = white
    grey = flat(1 << (bits - 1), (4, 8), dtype)
    path = write_clip(
        tmp_path / "a.mkv", [luma if pixels == "gray" else (luma, grey, grey)], [0], pixels=pixels, limited=limited
    )
    video = Video(path, Reading("as-is"))
    assert video.steps == white - black
    rgb = first(video)
    np.testing.assert_allclose(rgb[:, :, :8], 0.0, atol=1e-6)
    np.testing.assert_allclose(rgb[:, :, 8:], 1.0, atol=1e-6)


@pytest.mark.parametrize(
    ("own", "other"), [("yuv420p", "nv12"), ("yuv420p10le", "yuv420p10be"), ("yuv420p10le", "p010le")]
)
def test_however_samples_are_laid_out_they_are_the_same_light(own, other):
    """Chroma interleaved or in planes of its own, 16 bits with the higher or the lower byte first."""
    rng = np.random.default_rng(1)
    frame = av.VideoFrame.from_ndarray(rng.integers(0, 256, (12, 16), np.uint8), format="yuv420p")
    frame = frame.reformat(format=own, src_color_range=2, dst_color_range=2)
    frame.color_range = 2
    apart, together = (np.zeros((3, 8, 16), np.float32) for _ in range(2))
    to_light(frame, pixel_format(frame, "a"), "as-is", apart)
    woven = frame.reformat(format=other, src_color_range=2, dst_color_range=2)
    woven.color_range = 2
    to_light(woven, pixel_format(woven, "a"), "as-is", together)
    np.testing.assert_array_equal(apart, together)


def test_pixels_of_odd_sides_have_the_chroma_that_they_share():
    """Four pixels share a sample; at an odd end two do, and one in the corner: Rec. 601's red by hand."""
    rng = np.random.default_rng(4)
    luma, cr = rng.integers(60, 90, (5, 7), np.uint8), rng.integers(100, 150, (3, 4), np.uint8)
    frame = frame_of((luma, np.full((3, 4), 128, np.uint8), cr), "yuv420p", 7, 5)
    frame.color_range = 2
    found = np.zeros((3, 5, 7), np.float32)
    to_light(frame, pixel_format(frame, "a"), "as-is", found)
    shared = cr[np.arange(5)[:, None] // 2, np.arange(7) // 2].astype(float)
    np.testing.assert_allclose(found[0], (luma + 1.402 * (shared - 128)) / 255, atol=1e-5)
    np.testing.assert_allclose(found[2], luma / 255, atol=1e-6)


def test_highlights_and_wide_colours_are_kept(tmp_path):
    # A PQ clip in BT.2020 whose white is 1000 cd/m²: 4.9 times diffuse white, and its luminance that of BT.2020.
    stored = encode(np.array([1000, 0, 0]) / 203, "pq")
    rgb16 = np.round(np.tile(stored, (8, 16, 1)) * 65535).astype(np.uint16)
    path = write_clip(tmp_path / "a.mkv", [rgb16], [0], pixels="gbrp16le", trc=16, primaries=9, matrix=0)
    source = Video(path)
    assert source.transfer == "pq"
    r, g, b = first(source)[:, 0, 0]
    assert 0.2126 * r + 0.7152 * g + 0.0722 * b == pytest.approx(0.2627 * 1000 / 203, rel=2e-3)
    assert r > 5


@pytest.mark.parametrize(("dtype", "ending"), [(np.uint8, ".png"), (np.uint16, ".png"), (np.uint16, ".tif")])
@pytest.mark.parametrize("colour", [False, True])
def test_pictures_of_8_and_16_bits(tmp_path, dtype, ending, colour):
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(2)
    top = np.iinfo(dtype).max
    picture = rng.integers(0, top + 1, (6, 10, 3) if colour else (6, 10)).astype(dtype)
    cv2.imwrite(str(tmp_path / f"a1{ending}"), picture[..., ::-1] if colour else picture)
    light = first(Pictures(tmp_path, Reading("linear", fps=10)))
    expected = np.moveaxis(picture, 2, 0) if colour else picture
    np.testing.assert_allclose(light, np.broadcast_to(expected / top, (3, 6, 10)), atol=1e-6)


def test_floating_point_pictures_are_linear(tmp_path):
    cv2 = pytest.importorskip("cv2")
    picture = np.linspace(0, 40, 180, dtype=np.float32).reshape(6, 10, 3)
    cv2.imwrite(str(tmp_path / "a.tif"), picture[..., ::-1])
    source = Pictures(tmp_path, Reading(fps=10))
    assert (source.transfer, source.floor(0.2)) == ("linear", None)
    np.testing.assert_allclose(first(source), np.moveaxis(picture, 2, 0))


def test_jpeg_has_full_range(tmp_path):
    from PIL import Image

    Image.fromarray(flat((250, 10, 130), (16, 16, 3))).save(tmp_path / "a.jpg", quality=100)
    light = first(Pictures(tmp_path, Reading("as-is", fps=10)))
    np.testing.assert_allclose(light.mean(axis=(1, 2)), np.array([250, 10, 130]) / 255, atol=0.01)


def test_pictures_are_ordered_by_their_numbers(tmp_path):
    from PIL import Image

    for number in (1, 2, 10):
        Image.fromarray(flat(number)).save(tmp_path / f"view{number}.png")
    source = Pictures(tmp_path, Reading("linear", fps=10))
    frame = Frame(page_aligned((3, 8, 16)), RADIANCE)
    seen = []
    for index in range(3):
        source.fill(index, frame)
        seen.append(round(float(frame.planes[0, 0, 0]) * 255))
    assert seen == [1, 2, 10]


def test_a_matrix_that_is_not_known_is_refused(tmp_path):
    path = write_clip(tmp_path / "a.mkv", [(flat(80), flat(128), flat(128))], [0], pixels="yuv444p", matrix=8)
    with pytest.raises(InputError, match="colour matrix"):
        Video(path)


# 100 % red of BT.601 and of BT.709 in limited range, 8 bits, as the recommendations have them.
_RED = {6: (81, 90, 240), 1: (63, 102, 240)}


@pytest.mark.parametrize("layout", ["xyz12le", "yuv444p10msble"])
def test_pixels_that_are_laid_out_in_a_rare_way_are_refused(layout):
    """Of digital cinema, and with padding below the bits: they were taken for what they are not."""
    try:
        frame = av.VideoFrame(16, 16, layout)
    except ValueError:
        pytest.skip("this libav does not know it")
    with pytest.raises(InputError, match=f"a: stores pixels as {layout}, expected grey, RGB, or luma and chroma"):
        pixel_format(frame, "a")


@pytest.mark.parametrize("told", [0, 1, 2])
@pytest.mark.parametrize("layout", ["rgb565le", "bgr555le", "monob"])
def test_few_bits_have_full_range_whatever_is_told(layout, told):
    frame = av.VideoFrame.from_ndarray(np.full((8, 16, 3), 255, np.uint8), format="rgb24").reformat(format=layout)
    frame.color_range = told
    out = np.zeros((3, 8, 16), np.float32)
    to_light(frame, pixel_format(frame, "a"), "as-is", out)
    np.testing.assert_allclose(out, 1.0, atol=1e-3)


@pytest.mark.parametrize(("rows", "matrix"), [(480, 6), (576, 6), (578, 1), (720, 1)])
def test_clips_that_do_not_tell_their_matrix_have_that_of_their_size(tmp_path, rows, matrix):
    """Both standards of television, NTSC with 480 rows and PAL with 576, are BT.601's."""
    y, cb, cr = _RED[matrix]
    planes = (flat(y, (rows, 16)), flat(cb, (rows // 2, 8)), flat(cr, (rows // 2, 8)))
    path = write_clip(tmp_path / "a.mkv", [planes], [0], pixels="yuv420p", limited=True)
    np.testing.assert_allclose(first(Video(path, Reading("as-is"))).mean(axis=(1, 2)), (1, 0, 0), atol=0.01)


BT709, SRGB, PQ, HLG = "bt709", "srgb", "pq", "hlg"
H273 = {
    1: BT709, 2: None, 4: None, 5: None, 6: BT709, 7: BT709, 8: "linear", 9: None, 13: SRGB, 14: BT709, 15: BT709,
    16: PQ, 18: HLG,
}  # fmt: skip
"""Transfer characteristics of ITU-T H.273: 1, 6, 14 and 15 are one function, and SMPTE 240M's is nearly that."""


@pytest.mark.parametrize("told", H273)
def test_a_streams_transfer_function_is_that_of_its_number(told):
    frame = av.VideoFrame.from_ndarray(np.zeros((12, 16), np.uint8), format="yuv420p")
    frame.color_trc = told
    assert pixel_format(frame, "a").transfer == H273[told]


def test_what_a_stream_does_not_tell_follows_from_what_it_does():
    """BT.2020's primaries have its weights (Rec. ITU-R BT.2020, table 4), and yuvj is full range by its name."""
    frame = av.VideoFrame(16, 12, "yuv420p")
    frame.color_primaries = 9
    assert pixel_format(frame, "a").weights == (0.2627, 0.0593) and not pixel_format(frame, "a").full
    assert pixel_format(av.VideoFrame(16, 12, "yuvj420p"), "a").full


def test_a_frame_is_read_alike_however_often():
    """Several threads of libav's get one of some thousand frames of P010 wrong."""
    asked = []

    class Noting:
        def __init__(self, frame):
            self._frame = frame

        def __getattr__(self, name):
            return getattr(self._frame, name)

        def reformat(self, **wanted):
            asked.append(wanted.get("threads"))
            return self._frame.reformat(**wanted)

    for pixels in ("nv12", "p010le", "rgb24", "bgr24", "gray"):
        frame = av.VideoFrame.from_ndarray(np.full((12, 16), 99, np.uint8), format="yuv420p").reformat(format=pixels)
        to_light(Noting(frame), pixel_format(frame, "a"), "as-is", np.zeros((3, 8, 16), np.float32))
    assert len(asked) >= 3 and set(asked) == {1}


@pytest.mark.parametrize(
    ("primaries", "matrix"),
    [
        (12, [[1.2249, -0.2249, 0.0], [-0.0421, 1.0421, 0.0], [-0.0196, -0.0786, 1.0983]]),
        (1, np.eye(3)),
        (2, np.eye(3)),
    ],
)
def test_colours_of_display_p3_become_those_of_rec_709(tmp_path, primaries, matrix):
    """SMPTE RP 431-2 with the white of D65, as telephones have it; the matrix is that of colour.js and of Safari."""
    codes = np.zeros((8, 16, 3), np.uint16)
    codes[:, range(3), range(3)] = 65535
    path = write_clip(tmp_path / "a.mkv", [codes], [0], pixels="gbrp16le", primaries=primaries, matrix=0)
    found = first(Video(path, Reading("linear")))
    np.testing.assert_allclose(found[:, 0, :3], matrix, atol=2e-4)
    np.testing.assert_allclose(first(Video(path, Reading("as-is")))[:, 0, :3], np.eye(3), atol=1e-6)
