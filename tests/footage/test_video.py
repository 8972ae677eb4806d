"""Video and arrays: times, events by theory, and what is refused."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.events.batch import gather
from clsim.footage.arrays import Arrays
from clsim.footage.source import Reading
from clsim.footage.video import Video, told_end
from clsim.frames import RADIANCE, Frame, SourceEnded, page_aligned
from tests.footage.clips import HEIGHT, WIDTH, encode, grating, grating_events, write_clip

_FRAMES, _FPS = 114, 200


def frame_times(path, **options):
    source = Video(path, Reading("linear", **options))
    frame = Frame(page_aligned((3, source.height, source.width)), RADIANCE)
    times = []
    try:
        while True:
            source.fill(len(times), frame)
            times.append(frame.time_us)
    except SourceEnded:
        return times
    finally:
        source.close()


@pytest.mark.parametrize("transfer", ["srgb", "bt709", "pq", "hlg", "linear"])
def test_a_moving_grating_makes_the_events_of_theory(tmp_path, transfer):
    stored = [encode(grating(k / _FPS), transfer) for k in range(_FRAMES)]
    clip = [np.round(values * 65535).astype(np.uint16) for values in stored]
    times = [k * 1_000_000 // _FPS for k in range(_FRAMES)]
    path = write_clip(
        tmp_path / "a.mkv", clip, [t // 1000 for t in times], pixels="gray16le", time_base=Fraction(1, 1000)
    )
    events = gather(clsim.events_from(str(path), transfer=transfer))
    theory = grating_events((_FRAMES - 1) / _FPS)
    assert len(theory) > 12 * WIDTH
    for y in (0, HEIGHT - 1):
        row = events[events["y"] == y]
        for x in range(WIDTH):
            mine, expected = row[row["x"] == x], theory[theory["x"] == x]
            assert list(mine["on"]) == list(expected["on"])
            # Between frames, 5 ms apart, light is taken as linear in its log: off by its curvature, most at extremes.
            late_us = np.abs(mine["t"] - expected["t"])
            assert late_us.max() < 2500
            assert np.median(late_us) < 60


def test_undoing_another_curve_makes_other_events(tmp_path):
    clip = [np.round(encode(grating(k / _FPS), "srgb") * 65535).astype(np.uint16) for k in range(_FRAMES)]
    times = [k * 1_000_000 // _FPS for k in range(_FRAMES)]
    right, wrong = (sum(map(len, clsim.events_from(clip, times, transfer=transfer))) for transfer in ("srgb", "as-is"))
    # Stored values have the contrast of light over about 2.2.
    assert 1.9 < right / wrong < 2.9


def test_frames_of_a_variable_rate_have_their_own_times(tmp_path):
    light = [flat * np.ones((HEIGHT, WIDTH)) for flat in (0.2, 0.3, 0.3, 0.6)]
    clip = [np.round(values * 65535).astype(np.uint16) for values in light]
    path = write_clip(tmp_path / "a.mkv", clip, [0, 33, 50, 200], pixels="gray16le")
    assert frame_times(path) == [0, 33_000, 50_000, 200_000]
    events = gather(clsim.events_from(str(path), transfer="linear"))
    one = events[(events["x"] == 3) & (events["y"] == 3)]
    # ln 0.3/0.2 = 0.405: thresholds at 0.2 and 0.4; ln 0.6/0.3 = 0.693 more: at 0.6, 0.8 and 1.0.
    rise, more = np.log(1.5), np.log(2.0)
    expected = [33e3 * 0.2 / rise, 33e3 * 0.4 / rise]
    expected += [50e3 + 150e3 * (level - rise) / more for level in (0.6, 0.8, 1.0)]
    np.testing.assert_allclose(one["t"], expected, atol=30)
    assert one["on"].all()


def test_a_video_whose_first_frame_comes_late_keeps_its_times(tmp_path):
    """Of tracks that begin together, the picture may be the later one."""
    clip = [np.full((HEIGHT, WIDTH), 100, np.uint8)] * 3
    times = [500, 520, 560]
    path = write_clip(tmp_path / "a.mkv", clip, times, pixels="gray")
    assert frame_times(path) == [1000 * time for time in times]


def test_times_may_be_given(tmp_path):
    clip = [np.full((HEIGHT, WIDTH), 1000, np.uint16)] * 3
    path = write_clip(tmp_path / "a.mkv", clip, [0, 40, 80], pixels="gray16le")
    assert frame_times(path, fps=300.0) == [0, 3333, 6667]
    assert frame_times(path, times_us=[5, 7, 100]) == [5, 7, 100]
    assert frame_times(path, times_us=[5, 7]) == [5, 7]


def test_a_video_without_transfer_function_says_what_it_took(tmp_path):
    clip = [np.full((HEIGHT, WIDTH), 1000, np.uint16)]
    source = Video(write_clip(tmp_path / "a.mkv", clip, [0], pixels="gray16le"))
    assert source.transfer == "bt709"
    assert "taken as bt709" in source.warnings[0]
    told = Video(write_clip(tmp_path / "b.mkv", clip, [0], pixels="gray16le", trc=18))
    assert (told.transfer, told.warnings) == ("hlg", ())


def test_arrays_of_floating_point_keep_highlights():
    bright = np.full((HEIGHT, WIDTH), 1.0)
    events = gather(clsim.events_from([bright, bright * np.exp(2.1)], [0, 1000], threshold_on=0.5))
    assert len(events) == 4 * WIDTH * HEIGHT
    np.testing.assert_allclose(np.unique(events["t"]), [1000 * k * 0.5 / 2.1 for k in (1, 2, 3, 4)], atol=1.1)


@pytest.mark.parametrize(
    ("frames", "times", "sentence"),
    [
        ([], [], "there is no frame"),
        ([np.zeros((4, 4))], None, "give `fps` or `times_us`"),
        ([np.zeros((4, 4), np.int64)], [0], "uint8"),
        ([np.zeros((4, 4, 2))], [0], r"\[4, 4, 2\]"),
        ([np.zeros((4, 4)), np.zeros((4, 5))], [0, 1], "frame 1"),
        ([np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.uint16)], [0, 1], "frame 1 is an array of uint16"),
        ([np.zeros((4, 4))] * 2, [5, 5], "later than 5"),
        ([np.zeros((4, 4))] * 2, [5], "no time for frame 1"),
    ],
)
def test_arrays_that_cannot_be_used(frames, times, sentence):
    with pytest.raises(InputError, match=sentence):
        source = Arrays(frames, times)
        frame = Frame(page_aligned((3, source.height, source.width)), RADIANCE)
        for index in range(len(frames)):
            source.fill(index, frame)


def test_files_that_are_no_video(tmp_path):
    text = tmp_path / "a.mp4"
    text.write_text("this is no video, however often it is read\n" * 50)
    with pytest.raises(InputError, match=r"a\.mp4"):
        Video(text)
    with pytest.raises(InputError, match="no such file"):
        Video(tmp_path / "b.mp4")
    for name in ("a.txt", "a.nfo"):  # libav would draw the letters
        (tmp_path / name).write_text("7474 23 16 1\n" * 50)
        with pytest.raises(InputError, match=rf"{name}: holds text, expected a video"):
            Video(tmp_path / name)
    clip = [np.random.default_rng(k).integers(0, 65535, (HEIGHT, WIDTH)).astype(np.uint16) for k in range(30)]
    whole = write_clip(tmp_path / "c.mkv", clip, list(range(0, 300, 10)), pixels="gray16le").read_bytes()
    rng = np.random.default_rng(3)
    for cut in rng.integers(1, len(whole), 20):
        torn = tmp_path / "torn.mkv"
        damaged = bytearray(whole[:cut])
        damaged[cut // 2] ^= 0xFF
        torn.write_bytes(damaged)
        try:
            assert len(frame_times(torn)) <= 30
        except InputError as error:
            assert "torn.mkv" in str(error)


@pytest.mark.parametrize("rate", [Fraction(30000, 1001), Fraction(24000, 1001), Fraction(60), Fraction(90000, 7)])
def test_times_of_frames_are_the_streams_to_the_nearest_microsecond(tmp_path, rate):
    clip = [np.full((HEIGHT, WIDTH), 1000, np.uint16)] * 12
    path = write_clip(tmp_path / "a.nut", clip, list(range(12)), pixels="gray16le", time_base=1 / rate)
    exact = [Fraction(k) / rate * 1_000_000 for k in range(12)]
    assert all(abs(found - time) <= Fraction(1, 2) for found, time in zip(frame_times(path), exact, strict=True))


def test_a_video_with_fewer_frames_than_there_are_times_is_told(tmp_path):
    """Frames that were dropped have times too, and all that follow would have those of others."""
    path = write_clip(tmp_path / "a.mkv", [np.zeros((8, 8), np.uint8)] * 3, [0, 40, 80], pixels="gray")
    for times, count in (((0, 10, 20), 3), ((0, 10), 2)):
        assert len(list(clsim.events_from(str(path), times, transfer="srgb"))) == count
    with pytest.raises(InputError, match=r"a\.mkv: ends after 3 frames, but there are 5 times"):
        list(clsim.events_from(str(path), (0, 10, 20, 30, 40), transfer="srgb"))


def test_a_transfer_function_that_is_not_known_is_told_as_such(tmp_path):
    for told, sentence in ((2, "does not tell its transfer function"), (4, "has the transfer function 4 of H.273")):
        path = write_clip(tmp_path / "a.mkv", [np.zeros((8, 8), np.uint8)], [0], pixels="gray", trc=told)
        (warning,) = Video(path).warnings
        assert sentence in warning and warning.endswith(": taken as bt709; see `transfer`")


@pytest.mark.parametrize(
    ("kind", "stream", "whole", "end_s"),
    [
        ("mov,mp4,m4a", (500, 2000, {}), (None, None), 2.5),
        ("matroska,webm", (0, None, {"DURATION": "01:02:03.500000000"}), (None, None), 3723.5),
        ("matroska,webm", (0, None, {}), (500_000, 2_000_000), 2.5),
        ("avi", (0, 9000, {}), (0, 2_000_000), 2.0),
        ("mpegts", (0, 9000, {}), (0, 2_000_000), None),
    ],
)
def test_the_end_that_a_header_tells_counts_from_where_time_begins(kind, stream, whole, end_s):
    """A film longer than an hour, or whose picture comes late, is cut all the same where it ends before."""
    names = ("start_time", "duration", "metadata")
    video = SimpleNamespace(time_base=Fraction(1, 1000), **dict(zip(names, stream, strict=True)))
    streams = type("Streams", (list,), {"video": [video]})([video])
    container = SimpleNamespace(format=SimpleNamespace(name=kind), streams=streams)
    container.start_time, container.duration = whole
    assert told_end(container) == end_s
