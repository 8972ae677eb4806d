"""Why a run has no events, where that is known."""

from dataclasses import replace

import numpy as np
import pytest

from clsim.frames import Frame
from clsim.live.outputs.silence import Silence
from clsim.live.pipeline import Progress
from clsim.scene import World, load_world

THRESHOLDS = {"on": 0.3, "off": 0.2}


def told(
    coverage: float, changes: list[float], world: World | None = None, progress: Progress | None = None, **options: str
) -> str | None:
    """Return what is told of a run whose pixels change so far from frame to frame; one has no level."""
    progress = progress or Progress(frames=len(changes) + 1)
    silence = Silence(progress, {"thresholds": THRESHOLDS, "options": options}, world)
    frame = Frame(np.full((1, 2, 3), coverage, np.float32), ("Coverage",))
    for level in (0.0, *changes):
        if silence.wants_frame():
            silence.show_frame(frame, np.array([[1.0, 1.0, 1.0 + level], [np.nan, 2.0, 0.5]], np.float32))
    return silence.told


@pytest.fixture(scope="module")
def world() -> World:
    return load_world("two-boxes")


def test_a_camera_that_sees_nothing(world: World) -> None:
    text = told(0.0, [0.0, 0.0], world)
    assert text is not None and text.startswith("the camera sees nothing but a background") and "opengl" not in text
    for axes, is_told in (("opencv", True), ("opengl", False)):
        text = told(0.0, [0.0], world, camera_path="poses.txt", camera_axes=axes)
        assert text is not None and text.startswith("the camera sees nothing") and ("camera_axes" in text) is is_told
    assert "the camera sees" not in (told(0.01, [0.0], world) or "")
    assert "the camera sees" not in (told(0.0, [0.0]) or "")  # recorded frames, whose background may be any


@pytest.mark.parametrize("change", [0.125, -0.125])
def test_brightness_that_changes_by_less_than_the_threshold(world: World, change: float) -> None:
    expected = "no pixel's brightness changed by the threshold of 0.2: the largest change that was seen is 0.12; "
    assert (told(1.0, [0.0625, change, 0.0], world) or "").startswith(expected)
    assert told(1.0, [0.25, 0.0], world) is None  # something else keeps it from firing
    assert told(1.0, []) is None  # one frame has no changes
    for progress in (
        Progress(frames=2, events=1),
        Progress(frames=2, masked_pixels=1),
        Progress(frames=2, lost_events=1),
    ):
        assert told(0.0, [0.125], world, progress) is None


def test_what_is_too_dark_for_the_pixels_is_told(world: World) -> None:
    silence = Silence(Progress(frames=2), {"thresholds": THRESHOLDS, "options": {}}, world)
    frame = Frame(np.ones((1, 2, 3), np.float32), ("Coverage",))
    for _ in range(2):
        silence.show_frame(frame, np.full((2, 3), np.log(world.sensor.floor), np.float32))
    assert "darker than the pixels' `floor` of 0.0001" in (silence.told or "")


def test_nothing_has_no_sign() -> None:
    assert "the largest change that was seen is 0;" in (told(1.0, [0.0]) or "")


def test_scenes_where_nothing_moves_or_shines_are_not_accused(world: World) -> None:
    assert told(1.0, [0.0], load_world("still")) is None
    assert told(0.0, [0.0], replace(world, environment=(0.0, 0.0, 0.0), sphere_lights=(), instances=())) is None


def test_few_frames_are_looked_at_and_none_once_there_are_events() -> None:
    progress = Progress()
    silence = Silence(progress, {"thresholds": THRESHOLDS, "options": {}}, None)
    assert [k for k in range(70) if silence.wants_frame()] == [0, 1, 2, 4, 8, 16, 32, 64]
    silence, progress.events = Silence(progress, {"thresholds": THRESHOLDS, "options": {}}, None), 1
    assert not any(silence.wants_frame() for _ in range(4))
