"""Footage value by value: what a viewer shows, what standards say, and what Python's own arithmetic makes of it."""

from __future__ import annotations

import warnings
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

import clsim
from clsim.errors import Notice
from clsim.footage.arrays import Arrays
from clsim.footage.images import Pictures
from clsim.footage.source import Footage, Reading
from clsim.footage.times import read_times_us
from clsim.footage.transfer import decode, quantisation_floor
from clsim.footage.video import Video
from clsim.frames import RADIANCE, Frame, page_aligned
from clsim.live.footage import FootageOptions, footage_detector
from tests.footage.clips import encode, write_clip


def first(source: Footage) -> np.ndarray:
    frame = Frame(page_aligned((3, source.height, source.width)), RADIANCE)
    source.fill(0, frame)
    source.close()
    return frame.planes


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_a_turned_or_mirrored_video_is_seen_as_players_show_it(tmp_path: Path, degrees: int, mirrored: bool) -> None:
    """Phones write what the chip saw, and a matrix that turns it clockwise (ISO/IEC 14496-12, 8.3.2).

    That of a front camera mirrors it first, as x becomes -x.
    """
    codes = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    path = write_clip(tmp_path / "a.mov", [codes], [0], pixels="rgb24", codec="png")
    data = bytearray(path.read_bytes())
    cos, sin = round(np.cos(np.radians(degrees))), round(np.sin(np.radians(degrees)))
    at = data.index(b"tkhd") + 44
    x = -1 if mirrored else 1
    matrix = np.array([x * cos << 16, x * sin << 16, 0, -sin << 16, cos << 16, 0, 0, 0, 1 << 30], ">i4")
    assert data[at : at + 4] == b"\0\1\0\0", "the identity's first number"
    data[at : at + 36] = matrix.tobytes()
    path.write_bytes(data)
    shown = np.rot90(codes[:, ::x], -degrees // 90)
    source = Video(path, Reading("linear"))
    assert (source.width, source.height) == (shown.shape[1], shown.shape[0])
    np.testing.assert_allclose(first(source), np.moveaxis(shown, 2, 0) / 255, atol=1e-6)


def test_the_rate_of_pictures_with_times_is_their_mean(tmp_path: Path) -> None:
    from PIL import Image

    for k in range(4):
        Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / f"a{k}.png")
    assert Pictures(tmp_path, Reading(times_us=[0, 5_000, 20_000, 60_000])).fps == pytest.approx(50.0)


def test_as_is_keeps_stored_values_and_primaries(tmp_path: Path) -> None:
    """Of BT.2020 too: red alone stays red alone."""
    codes = np.zeros((8, 16, 3), np.uint16)
    codes[..., 0] = 30_000
    path = write_clip(tmp_path / "a.mkv", [codes], [0], pixels="gbrp16le", trc=16, primaries=9, matrix=0)
    light = first(Video(path, Reading("as-is")))
    assert light[0] == pytest.approx(30_000 / 65_535) and (light[1:] == 0).all()


@pytest.mark.parametrize("transfer", ["srgb", "bt709", "linear", "pq", "hlg"])
@pytest.mark.parametrize("steps", [255, 219, 876])
@pytest.mark.parametrize("contrast", [0.1, 0.2, 0.5])
def test_from_the_floor_on_a_step_changes_the_log_by_no_more(transfer: str, steps: int, contrast: float) -> None:
    light = np.arange(steps + 1, dtype=np.float32) / np.float32(steps)
    decode(light, transfer)  # type: ignore[arg-type]
    light = light.astype(np.float64)
    floor = quantisation_floor(transfer, steps, contrast)  # type: ignore[arg-type]
    at = int(np.argmin(np.abs(light - floor)))
    assert light[at] == pytest.approx(floor)
    assert (np.diff(np.log(light[at:])) <= contrast).all()
    assert at == steps or at == 1 or np.log(light[at] / light[at - 1]) > contrast, "and no lower one will do"


@pytest.mark.parametrize("planar", [False, True])
def test_floating_point_tiff_in_planes_and_in_pixels(tmp_path: Path, planar: bool) -> None:
    picture = np.linspace(0, 3, 5 * 7 * 3, dtype=np.float32).reshape(5, 7, 3)
    options = {"planarconfig": "separate"} if planar else {}
    stored = np.moveaxis(picture, 2, 0) if planar else picture
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="rgb", **options)
    np.testing.assert_allclose(first(Pictures(tmp_path, Reading(fps=10))), np.moveaxis(picture, 2, 0))


@settings(max_examples=40)
@given(st.lists(st.integers(0, 10**15), min_size=1, max_size=8, unique=True), st.booleans())
def test_nanoseconds_are_rounded_to_the_nearest_microsecond(tmp_path_factory, times_ns: list[int], text: bool) -> None:
    times_ns = sorted({1000 * (t // 1000) + t % 1000 for t in times_ns if t % 1000 != 500})
    if len({round(Fraction(t, 1000)) for t in times_ns}) < max(1, len(times_ns)):
        return
    path = tmp_path_factory.mktemp("times") / ("a.txt" if text else "a.npy")
    if text:
        path.write_text("".join(f"{t}\n" for t in times_ns))
    else:
        np.save(path, np.array(times_ns))
    assert read_times_us(path, "ns") == [round(Fraction(t, 1000)) for t in times_ns]


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_arrays_are_shares_of_their_types_largest_number_and_an_offset_is_added(kind: type) -> None:
    top = 1.0 if kind is np.float32 else np.iinfo(kind).max
    codes = np.array([[0, top, top / 3, top / 5]], kind)
    source = Arrays([codes], [0], "linear", offset=0.25)
    np.testing.assert_allclose(first(source), np.broadcast_to(codes / top + 0.25, (3, 1, 4)), rtol=1e-6)


def test_whole_numbers_are_srgb_unless_told_and_floating_point_is_linear() -> None:
    """IEC 61966-2-1, by its forward curve."""
    light = np.linspace(0.001, 1.0, 64)[None]
    stored = np.round(encode(light, "srgb") * 65_535).astype(np.uint16)
    np.testing.assert_allclose(first(Arrays([stored], [0])), np.broadcast_to(light, (3, 1, 64)), rtol=2e-3)
    np.testing.assert_allclose(first(Arrays([light.astype(np.float32)], [0]))[0], light, rtol=1e-6)


@pytest.mark.parametrize(("scale", "on", "off"), [(0.25, 0.2, 0.2), (8.0, 0.2, 0.5), (1.0, 0.5, 0.2)])
def test_the_floor_is_that_of_scaled_light_and_of_the_smaller_threshold(scale: float, on: float, off: float) -> None:
    """L = ln max(scale·Y, floor): where light is scaled, so is the light below which steps are too coarse."""
    source = Arrays([np.zeros((2, 2), np.uint8)], [0], "linear")
    given = {"threshold_on": on, "threshold_off": off, "scale": scale}
    config = footage_detector(source, FootageOptions("").settings, given)
    assert config.floor == pytest.approx(scale * quantisation_floor("linear", 255, 0.2))


def test_events_of_arrays_at_a_rate_are_those_at_its_times() -> None:
    rng = np.random.default_rng(3)
    frames = [rng.uniform(0.1, 1.0, (4, 6)).astype(np.float32) for _ in range(5)]
    told, rated = (
        np.concatenate(list(clsim.events_from(frames, **how)))
        for how in ({"times_us": [0, 3333, 6667, 10_000, 13_333]}, {"fps": 300.0})
    )
    assert len(told) > 50 and told.tobytes() == rated.tobytes()


def test_times_before_0_begin_at_0(tmp_path: Path) -> None:
    """Where an encoder's delay is told as negative times, the first frame is at 0 all the same."""
    clip = [np.full((8, 48), 1000 * k, np.uint16) for k in range(3)]
    path = write_clip(tmp_path / "a.mkv", clip, [0, 40, 80], pixels="gray16le")
    source = Video(path, Reading("linear"))
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    for frame in frames:
        frame.pts -= 25
    source.close()
    from clsim.footage import video

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(video, "first_frame", lambda container, where: (frames[0], iter(frames[1:])))
        early = Video(path, Reading("linear"))
        frame, times = Frame(page_aligned((3, 8, 48)), RADIANCE), []
        for index in range(3):
            early.fill(index, frame)
            times.append(frame.time_us)
        early.close()
    assert times == [0, 40_000, 80_000]


def test_footages_unit_of_light_is_told_by_scale_or_by_lux() -> None:
    """The same light in units four times as large: a sensor that reads light fires the same, bit by bit."""
    rng = np.random.default_rng(5)
    frames = [rng.uniform(0.1, 1.0, (8, 16)).astype(np.float32) for _ in range(4)]
    found = []
    for unit in (1.0, 0.25):
        seen = [frame / np.float32(unit) for frame in frames]
        options = {"sensor": "davis346", "fps": 100.0, "scale": unit, "lux_per_unit": 100.0 * unit}
        found.append(np.concatenate(list(clsim.events_from(seen, **options))))
    assert len(found[0]) > 200 and found[0].tobytes() == found[1].tobytes()
    other = np.concatenate(list(clsim.events_from(frames, sensor="davis346", fps=100.0, seed=1)))
    assert other.tobytes() != found[0].tobytes(), "another seed is another sensor"


def test_a_rate_that_is_told_is_that_of_the_video(tmp_path: Path) -> None:
    path = write_clip(tmp_path / "a.mkv", [np.zeros((8, 48), np.uint8)] * 2, [0, 40], pixels="gray")
    assert Video(path, Reading("linear", fps=7.0)).fps == 7.0


def test_pictures_of_no_number_are_told() -> None:
    """They have no events, and one might look for the reason in vain."""
    pictures = np.full((3, 4, 5), 0.5, np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sum(map(len, clsim.events_from(pictures, fps=100.0))) == 0
    pictures[1:, 2, 3] = np.nan
    with pytest.warns(Notice, match="2 NaN or infinite pixels were masked"):
        list(clsim.events_from(pictures, fps=100.0))
