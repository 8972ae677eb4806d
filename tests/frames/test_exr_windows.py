"""EXR files whose pixels are not simply the picture: windows, luminance, chroma, depths."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clsim.errors import InputError
from clsim.frames.exr import ExrSequence
from clsim.frames.exr_read import _spread, _Window

CASES = Path(__file__).parents[3] / "shared" / "cases"
RNG = np.random.default_rng(0)


def box(left: int, top: int, right: int, bottom: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    return np.array([left, top], np.int32), np.array([right, bottom], np.int32)


def write(path: Path, channels: dict[str, npt.NDArray[Any]], **header: Any) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(header, {name: values.copy() for name, values in channels.items()}) as file:
        file.write(str(path))


def read(path: Path) -> dict[str, npt.NDArray[np.float32]]:
    source = ExrSequence(path, fps=60)
    frame = next(iter(source))
    return {name: frame.plane(name) for name in frame.names}


sides = st.integers(-9, 9)


@settings(deadline=None, max_examples=60)
@given(sides, sides, st.integers(1, 8), st.integers(1, 8), sides, sides, st.integers(1, 8), st.integers(1, 8))
def test_a_frame_is_what_the_display_window_shows(
    tmp_path_factory: pytest.TempPathFactory, x: int, y: int, w: int, h: int, left: int, top: int, wide: int, high: int
) -> None:
    path = tmp_path_factory.mktemp("exr") / "a.exr"
    pixels = RNG.uniform(0.1, 1, (h, w)).astype(np.float32)
    shown, held = box(left, top, left + wide - 1, top + high - 1), box(x, y, x + w - 1, y + h - 1)
    write(path, dict.fromkeys("RGB", pixels), dataWindow=held, displayWindow=shown)
    found = read(path)["G"]
    assert found.shape == (high, wide)
    for row in range(high):
        for column in range(wide):
            at = top + row - y, left + column - x
            inside = 0 <= at[0] < h and 0 <= at[1] < w
            assert found[row, column] == (pixels[at] if inside else 0)


def test_data_windows_may_differ_from_frame_to_frame_and_display_windows_may_not(tmp_path: Path) -> None:
    texture = RNG.uniform(0.1, 1, (6, 20)).astype(np.float32)
    for k, start in enumerate((0, 4)):
        pixels = dict.fromkeys("RGB", np.ascontiguousarray(texture[:, start : start + 12]))
        write(tmp_path / f"{k}.exr", pixels, dataWindow=box(start, 0, start + 11, 5), displayWindow=box(0, 0, 19, 5))
    held = [frame.plane("Coverage")[0].tolist() for frame in ExrSequence(tmp_path, fps=10)]
    assert held == [[1] * 12 + [0] * 8, [0] * 4 + [1] * 12 + [0] * 4]
    first, second = (frame.plane("R") for frame in ExrSequence(tmp_path, fps=10))
    assert np.array_equal(first[:, 4:12], second[:, 4:12]) and np.array_equal(first[:, :12], texture[:, :12])
    assert (first[:, 12:] == 0).all() and (second[:, :4] == 0).all()
    write(tmp_path / "1.exr", pixels, dataWindow=box(0, 0, 11, 5), displayWindow=box(0, 0, 18, 5))
    with pytest.raises(InputError, match=r"has 19×6 pixels, but 0\.exr has 20×6"):
        list(ExrSequence(tmp_path, fps=10))


def test_parts_have_windows_of_their_own(tmp_path: Path) -> None:
    depth, colour = np.full((2, 3), 5, np.float32), RNG.uniform(0.1, 1, (4, 6)).astype(np.float32)
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "displayWindow": box(0, 0, 5, 3)}
    parts = [
        OpenEXR.Part(head | {"dataWindow": box(0, 0, 5, 3)}, dict.fromkeys("RGB", colour.copy()), "View.Combined"),
        OpenEXR.Part(head | {"dataWindow": box(1, 1, 3, 2)}, {"Z": depth.copy()}, "View.Depth"),
    ]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    found = read(tmp_path / "a.exr")
    assert np.array_equal(found["R"], colour)
    expected = np.zeros((4, 6), np.float32)
    expected[1:3, 1:4] = 5
    assert np.array_equal(found["Depth"], expected)  # where nothing is held, nothing is seen
    assert np.array_equal(found["Coverage"], expected > 0)


def test_luminance_alone_is_grey_and_chroma_makes_colours(tmp_path: Path) -> None:
    rgb = RNG.uniform(0.1, 1, (3, 5, 7)).astype(np.float32)
    y = np.tensordot(np.array([0.2126, 0.7152, 0.0722], np.float32), rgb, 1)
    write(tmp_path / "grey.exr", {"Y": y, "A": np.ones_like(y)})
    assert all(np.array_equal(read(tmp_path / "grey.exr")[name], y) for name in "RGB")
    write(tmp_path / "colour.exr", {"Y": y, "RY": (rgb[0] - y) / y, "BY": (rgb[2] - y) / y})
    found = read(tmp_path / "colour.exr")
    assert np.allclose(np.stack([found[name] for name in "RGB"]), rgb, atol=1e-5)
    # BT.2020's primaries and D65, whose weights BT.2020 gives as .2627, .6780 and .0593.
    wide = np.tensordot(np.array([0.2627, 0.6780, 0.0593], np.float32), rgb, 1)
    primaries = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    channels = {"Y": wide, "RY": (rgb[0] - wide) / wide, "BY": (rgb[2] - wide) / wide}
    write(tmp_path / "wide.exr", channels, chromaticities=primaries)
    found = read(tmp_path / "wide.exr")
    # BT.2087 tells how they become Rec. 709's.
    to_709 = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]
    assert np.allclose(np.stack([found[name] for name in "RGB"]), np.tensordot(to_709, rgb, 1), atol=2e-4)


def test_colours_of_aces_become_those_of_rec_709(tmp_path: Path) -> None:
    rgb = RNG.uniform(0.1, 1, (3, 5, 7)).astype(np.float32)
    rgb[:, 0, 0] = 0.5
    acescg = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
    layer = {f"ViewLayer.Combined.{name}": each for name, each in zip("RGB", rgb, strict=True)}
    names = ("R", "G", "B", "Variance.R", "Variance.G", "Variance.B")
    write(tmp_path / "a.exr", dict(zip(names, (*rgb, *rgb), strict=True)), chromaticities=acescg)
    found = read(tmp_path / "a.exr")
    assert np.array_equal([found[name] for name in names[3:]], rgb), "no colours: their sums are not those of light"
    write(tmp_path / "a.exr", layer | {"ViewLayer.Depth.Z": rgb[0]}, chromaticities=acescg)
    found = read(tmp_path / "a.exr")
    # As OpenColorIO's configurations for ACES have it.
    to_709 = [[1.70505, -0.62179, -0.08326], [-0.13026, 1.1408, -0.01055], [-0.024, -0.12897, 1.15297]]
    assert np.allclose(np.stack([found[name] for name in "RGB"]), np.tensordot(to_709, rgb, 1), atol=1e-4)
    assert np.allclose([found[name][0, 0] for name in "RGB"], 0.5, atol=1e-4)
    assert np.array_equal(found["Depth"], rgb[0])
    for told in ((0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329), (0.0,) * 8):
        write(tmp_path / "a.exr", layer, chromaticities=told)
        assert np.array_equal([read(tmp_path / "a.exr")[name] for name in "RGB"], rgb)


def test_positions_are_not_taken_for_luminance(tmp_path: Path) -> None:
    write(tmp_path / "a.exr", {name: np.ones((2, 2), np.float32) for name in "XYZ"})
    with pytest.raises(InputError, match="has no radiance that a known layout names"):
        read(tmp_path / "a.exr")


def test_channels_that_have_fewer_samples_are_linear_between_them() -> None:
    """At half of the columns and a third of the rows; OpenEXR reads such files and does not write them."""
    y, x = np.mgrid[0:9, 0:8].astype(np.float32)
    plane = 0.01 * x + 0.02 * y + 0.003 * x * y
    found = _spread(plane[::3, ::2], (2, 3), _Window(5, 5, 12, 13))
    # Beyond the last samples nothing more is known.
    np.testing.assert_allclose(found[:7, :7], plane[:7, :7], atol=1e-6)
    np.testing.assert_array_equal(found[7:, 7], found[6, 6])


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not beside the checkout")
def test_the_shared_cases() -> None:
    with pytest.raises(InputError, match=r"a_0000\.exr is a deep image, with many depths in a pixel; expected a flat"):
        ExrSequence(CASES / "deep", fps=30)
    assert (ExrSequence(CASES / "overscan", fps=30).width, ExrSequence(CASES / "overscan", fps=30).height) == (32, 24)
    assert ExrSequence(CASES / "grey", fps=30).names == ("R", "G", "B")
    first, second = (frame.planes[:3] for frame in ExrSequence(CASES / "shift_texture", fps=30))
    assert first.shape == (3, 48, 80) and np.array_equal(first[:, :, 4:64], second[:, :, 4:64])


@pytest.mark.parametrize("name", ["rgba", "RGBA", "main.beauty", "C"])
def test_a_part_that_is_called_the_picture_is_it(tmp_path: Path, name: str) -> None:
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {channel: RNG.uniform(0.1, 1, (2, 3)).astype(np.float32) for channel in "RGB"}
    other = {channel: np.zeros((2, 3), np.float32) for channel in "RGB"}
    parts = [OpenEXR.Part(dict(head), other, "diffuse"), OpenEXR.Part(dict(head), dict(planes), name)]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    found = read(tmp_path / "a.exr")
    assert all(np.array_equal(found[channel], planes[channel]) for channel in "RGB")
