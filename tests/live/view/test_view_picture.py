import platform
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from clsim.errors import InputError
from clsim.events import EVENT_DTYPE, EventBatch
from clsim.live.view.colormaps import lut
from clsim.live.view.picture import Film, Look, film_images, write_picture
from tests.live.view.view_events import random_events

SIZE = (21, 15)
EVENTS = random_events(4000, *SIZE, begin_us=500_000, end_us=1_500_000)
BATCHES = [EVENTS[k : k + 333] for k in range(0, len(EVENTS), 333)]


def expected_images(look: Look, step_us: float) -> list[np.ndarray]:
    """The same by masks over all events."""
    images = []
    begin_us, last_us = int(EVENTS["t"][0]), int(EVENTS["t"][-1])
    while last_us >= begin_us + round(len(images) * step_us):
        end_us = begin_us + round((len(images) + 1) * step_us)
        sums = np.zeros((SIZE[1], SIZE[0]))
        reach_us = look.accumulate_us * (5 if look.decay else 1)
        inside = EVENTS[(EVENTS["t"] >= end_us - reach_us) & (EVENTS["t"] < end_us)]
        weights = np.exp((inside["t"] - end_us) / look.accumulate_us) if look.decay else np.ones(len(inside))
        np.add.at(sums, (inside["y"], inside["x"]), np.where(inside["on"], weights, -weights))
        images.append(128 + np.rint(np.clip(sums / look.full, -1, 1) * 127))
    return images


@pytest.mark.parametrize("look", [Look(), Look(accumulate_us=200_000), Look(accumulate_us=5_000), Look(decay=True)])
@pytest.mark.parametrize("step_us", [33_333.33, 250_000.0])
def test_pictures_are_those_of_masks_over_all_events(look: Look, step_us: float) -> None:
    images = list(film_images(BATCHES, SIZE, look, step_us))
    expected = expected_images(look, step_us)
    assert len(images) == len(expected)
    for image, wanted in zip(images, expected, strict=True):
        assert np.array_equal(image, wanted)


@pytest.mark.parametrize("last_us", [99, 100, 101, 199, 200, 300])
def test_each_event_is_in_one_picture_also_the_last_at_the_end_of_a_step(last_us: int) -> None:
    events = np.zeros(2, EVENT_DTYPE)
    events["t"], events["x"], events["on"] = (1_000, 1_000 + last_us), (3, 7), True
    images = list(film_images([events[:1], events[1:]], SIZE, Look(accumulate_us=100), 100.0))
    assert len(images) == last_us // 100 + 1
    assert [tuple(np.argwhere(image != 128)[:, 1]) for image in (images[0], images[-1])] == (
        [(3, 7)] * 2 if last_us < 100 else [(3,), (7,)]
    )


def test_a_gif_holds_every_picture_in_its_own_colours(tmp_path: Path) -> None:
    look = Look(colours="purple-green", scale=2)
    count = write_picture(str(tmp_path / "film.gif"), BATCHES, SIZE, look, Film(fps=30))
    expected = expected_images(look, 1e6 / 30)
    duration_ms = 0
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == count == len(expected) and film.info["loop"] == 0
        for k, wanted in enumerate(expected):
            film.seek(k)
            duration_ms += film.info["duration"]
            # To a hundredth of a second, which is the finest that a GIF tells.
            assert duration_ms == pytest.approx(1000 * (k + 1) / 30, abs=5.1)
            seen = np.asarray(film.convert("RGB"))
            colours = lut("purple-green")[wanted.astype(int)]
            assert np.array_equal(seen, colours.repeat(2, axis=0).repeat(2, axis=1))
    assert duration_ms == pytest.approx(1000 * count / 30, abs=10)


@pytest.mark.parametrize("speed", [0.1, 0.5, 2.0])
def test_slow_motion_has_more_pictures_of_less_time_each(tmp_path: Path, speed: float) -> None:
    """A film's second shows so many seconds of events."""
    count = write_picture(str(tmp_path / "film.gif"), BATCHES, SIZE, Look(), Film(fps=30, speed=speed))
    lasts_s = (int(EVENTS["t"][-1]) - int(EVENTS["t"][0])) * 1e-6
    assert count == pytest.approx(30 * lasts_s / speed, abs=1)


def test_a_png_may_show_a_time_shortly_after_the_last_event(tmp_path: Path) -> None:
    """Whose window still holds some; farther on there is nothing to see."""
    last_us = int(EVENTS["t"][-1])
    write_picture(str(tmp_path / "at.png"), BATCHES, SIZE, Look(), Film(), at_us=last_us + 5_000)
    with Image.open(tmp_path / "at.png") as picture:
        assert len(set(picture.convert("RGB").getdata())) > 1
    with pytest.raises(InputError, match="after the end of the recording"):
        write_picture(str(tmp_path / "late.png"), BATCHES, SIZE, Look(), Film(), at_us=last_us + 900_000)


@pytest.mark.parametrize("decay", [False, True])
def test_a_png_shows_the_window_that_is_asked_for(tmp_path: Path, decay: bool) -> None:
    """What fades is shown for five times as long."""
    look = Look(accumulate_us=60_000, scale=1, decay=decay)
    write_picture(str(tmp_path / "at.png"), BATCHES, SIZE, look, Film(), at_us=900_000)
    inside = EVENTS[(EVENTS["t"] >= 900_000 - 60_000 * (5 if decay else 1)) & (EVENTS["t"] < 900_000)]
    weights = np.exp((inside["t"] - 900_000) / 60_000) if decay else np.ones(len(inside))
    sums = np.zeros((SIZE[1], SIZE[0]))
    np.add.at(sums, (inside["y"], inside["x"]), np.where(inside["on"], weights, -weights))
    wanted = lut()[(128 + np.rint(np.clip(sums / 2, -1, 1) * 127)).astype(int)]
    with Image.open(tmp_path / "at.png") as picture:
        assert np.array_equal(np.asarray(picture.convert("RGB")), wanted)


def test_a_png_shows_the_fullest_window_unless_told(tmp_path: Path) -> None:
    burst = np.zeros(500, EVENT_DTYPE)
    burst["t"], burst["x"], burst["y"], burst["on"] = 1_010_000, 4, 3, True
    events = np.concatenate([EVENTS, burst])
    events.sort(order="t")
    write_picture(str(tmp_path / "full.png"), [events], SIZE, Look(full=100, scale=1), Film())
    with Image.open(tmp_path / "full.png") as picture:
        assert np.asarray(picture.convert("RGB"))[3, 4].tolist() == lut()[255].tolist()


def test_an_mp4_can_be_decoded(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="videos are an extra")
    events = EVENTS.copy()
    events["x"] %= 10
    events["on"] = True
    count = write_picture(str(tmp_path / "film.mp4"), [events], SIZE, Look(scale=3), Film(fps=25))
    with av.open(str(tmp_path / "film.mp4")) as film:
        stream = film.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24").astype(int) for frame in film.decode(stream)]
        assert float(stream.average_rate) == 25 and (stream.width, stream.height) == (64, 46)
    assert len(frames) == count
    write_picture(str(tmp_path / "even.mp4"), [events[:99]], SIZE, Look(scale=2), Film(fps=25))
    with av.open(str(tmp_path / "even.mp4")) as film:
        assert (film.streams.video[0].width, film.streams.video[0].height) == (42, 30)
    rest, on = lut()[128].astype(int), lut()[255].astype(int)
    for frame in frames[:-1]:
        assert np.abs(frame[:45, 40:63] - rest).mean() < 8
        assert frame[:45, :30, 0].mean() > rest[0] + 0.2 * (on[0] - rest[0])


@pytest.mark.parametrize(
    ("name", "batches", "sentence"),
    [
        ("film.avi", BATCHES, r"`to` .*film\.avi.*\.mp4, \.gif, \.png"),
        ("film.gif", [], "no events"),
        ("no/film.png", BATCHES, "no/film.png.*folder that exists"),
    ],
)
def test_wrong_input_is_one_sentence_and_leaves_nothing(
    tmp_path: Path, name: str, batches: list[EventBatch], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        write_picture(str(tmp_path / name), batches, SIZE, Look(), Film())
    assert list(tmp_path.iterdir()) == []


def test_a_source_that_breaks_leaves_no_film(tmp_path: Path) -> None:
    def broken():
        yield from BATCHES[:6]
        raise InputError("torn")

    (tmp_path / "film.gif").write_text("what was there")
    with pytest.raises(InputError, match="torn"):
        write_picture(str(tmp_path / "film.gif"), broken(), SIZE, Look(), Film())
    assert [p.name for p in tmp_path.iterdir()] == ["film.gif"]
    assert (tmp_path / "film.gif").read_text() == "what was there"


def test_what_a_killed_run_left_goes_and_links_stay(tmp_path: Path) -> None:
    left = tmp_path / f".film.gif.{platform.node()}.{2**22 + 1}.part"  # no process has such a number
    left.write_text("half a film")
    (tmp_path / "link.gif").symlink_to("film.gif")
    write_picture(str(tmp_path / "link.gif"), BATCHES, SIZE, Look(), Film())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["film.gif", "link.gif"]
    assert (tmp_path / "link.gif").is_symlink()
