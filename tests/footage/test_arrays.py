"""Arrays and times as programs hold them: of any form they mean the same, and what means nothing is told."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.events.batch import gather
from clsim.footage.source import check_size

TIMES_US = [0, 1000, 2000]
FRAMES = [np.random.default_rng(k).integers(9_000, 65_535, (6, 8), np.uint16) for k in range(3)]


def fired(frames: Any = FRAMES, times_us: Any = TIMES_US, **given: Any) -> bytes:
    return gather(clsim.events_from(frames, times_us, **given)).tobytes()


def refilled() -> Iterable[np.ndarray]:
    memory = np.empty_like(FRAMES[0])
    for frame in FRAMES:
        memory[:] = frame
        yield memory


FORMS: dict[str, Callable[[], Any]] = {
    "big-endian": lambda: [frame.astype(">u2") for frame in FRAMES],
    "columns first": lambda: [np.asfortranarray(frame) for frame in FRAMES],
    "in memory that is filled again": refilled,
    "one array": lambda: np.array(FRAMES),
    "read-only": lambda: [np.frombuffer(frame.tobytes(), np.uint16).reshape(6, 8) for frame in FRAMES],
    "with gaps": lambda: [np.repeat(frame, 2, axis=1)[:, ::2] for frame in FRAMES],
}


@pytest.mark.parametrize("form", sorted(FORMS))
def test_pictures_of_any_form_fire_the_same(form: str) -> None:
    assert fired(FORMS[form]()) == fired() != b""


def test_times_are_rounded_to_the_nearest_microsecond_whatever_numbers_they_are() -> None:
    """A sum of parts of a second is a little off: 999.9999 must not become 999."""
    numbers: list[Any] = [
        [0.2, 999.9999, 2000.3],
        np.array(TIMES_US, np.float32),
        np.array(TIMES_US, ">u8"),
        map(str, TIMES_US),
    ]
    for times_us in numbers:
        assert fired(times_us=times_us) == fired()


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"times_us": np.array(TIMES_US, "m8[ns]")}, r"`times_us` must be numbers of µs, got .*0.* for frame 0"),
        ({"times_us": [0, float("nan"), 2]}, "`times_us` must be numbers of µs, got nan for frame 1"),
        ({"times_us": [0, float("inf"), 2]}, "`times_us` must be numbers of µs, got inf for frame 1"),
        ({"times_us": [0, 1 << 63, 1 << 64]}, "`times_us` must be numbers of µs, got 9223372036854775808 for frame 1"),
        ({"times_us": 1000}, "`times_us` must be numbers of µs, got 1000"),
        ({"times_us": [-1, 0, 1]}, "`times_us` has -1 µs for frame 0, expected 0 or later"),
        (
            {"times_us": [0.0, 0.001, 0.002]},
            r"`times_us` has 0.001 µs \(seconds\?\) for frame 1, expected later than 0",
        ),
        ({"fps": 100.0}, "`fps` and `times_us` both tell when frames were taken"),
        ({"times_us": None, "fps": 0}, "`fps` must be a positive number"),
        ({"times_us": None, "fps": "30"}, "`fps` must be a finite number, got '30'"),
        ({"transfer": "gamma"}, "`transfer` must be one of srgb, .*, got 'gamma'"),
        ({"frames": None}, "`frames` must be the name of a video or folder, or arrays, got None"),
        ({"frames": [[[1, 2], [3]]]}, "frame 0 cannot be read as an array"),
    ],
    ids=str,
)
def test_what_means_nothing_is_told(given: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=rf"\A{sentence}[^\n]*\Z"):
        fired(**given)


def test_a_path_is_as_good_as_its_name(tmp_path: Path) -> None:
    from PIL import Image

    for k, frame in enumerate(FRAMES):
        Image.fromarray((frame >> 8).astype(np.uint8)).save(tmp_path / f"{k}.png")
    assert fired(tmp_path) == fired(str(tmp_path)) != b""


@pytest.mark.parametrize(("width", "height"), [(8193, 8192), (0, 5)])
def test_pictures_that_are_empty_or_larger_than_two_to_the_26_are_refused(width: int, height: int) -> None:
    check_size("a.png", 8192, 8192)
    with pytest.raises(InputError, match=f"a.png: has {width}×{height} pixels, expected 1 to 67108864 of them"):
        check_size("a.png", width, height)
