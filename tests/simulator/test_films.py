"""Events of a screen whose pictures are known."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import clsim
from clsim.live.pacing.base_rate import base_fps
from clsim.scene.pictures.images import decode_srgb
from tests.scene.pictures.test_film import write_pictures, write_video

SCENE = """
[camera]
position = [0.0, 1.0, 0.0]
look_at = [0.0, 0.0, 0.0]
resolution = [16, 12]
fov_deg = 30.0

[environment]
radiance = [{sky}, {sky}, {sky}]

[materials.screen]
{key} = {{ {film} }}
color = [1.0, 1.0, 1.0]
emission = [{glow}, {glow}, {glow}]

[[objects]]
shape = "quad"
size = [4.0, 4.0]
material = "screen"
"""
GREYS = (100, 200, 30, 31, 90)
FRAMES = 'frames = "shots/*.png", fps = 50'


def screen(folder: Path, film: str = FRAMES, key: str = "emission_texture") -> Path:
    write_pictures(folder / "shots", *GREYS)
    glow = key == "emission_texture"
    file = folder / "screen.toml"
    file.write_text(SCENE.format(key=key, film=film, glow=float(glow), sky=float(not glow)))
    return file


def expected(threshold: float) -> list[tuple[int, bool, int]]:
    """Return how often a pixel fires, which way, with each new picture: its reference moves by whole thresholds."""
    logs = np.log(decode_srgb(np.array(GREYS) / 255.0))
    reference, found = logs[0], []
    for k, log in enumerate(logs[1:], 1):
        steps = int(np.floor(abs(log - reference) / threshold))
        up = bool(log > reference)
        reference += (1 if up else -1) * steps * threshold
        if steps:
            found.append((steps, up, k))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("key", ["emission_texture", "texture"])
@pytest.mark.parametrize("options", [{"quality": "balanced"}, {"quality": "exact", "spp": 256}])
def test_a_screen_fires_as_its_pictures_change(tmp_path: Path, key: str, options: dict[str, Any]) -> None:
    """Of an even picture all pixels fire alike: a matt screen under an even sky, or one that glows, is its grey."""
    with clsim.Simulator(screen(tmp_path, key=key), fps=200.0, threshold=0.25, **options) as run:
        assert not run.warnings
        events = run.step(99_000)
    for y in range(12):
        for x in range(16):
            own = events[(events["x"] == x) & (events["y"] == y)]
            assert own["on"].tolist() == [up for steps, up, _ in expected(0.25) for _ in range(steps)]
            shown_us = np.repeat([k * 20_000 for *_, k in expected(0.25)], [steps for steps, *_ in expected(0.25)])
            assert ((own["t"] <= shown_us) & (own["t"] > shown_us - 5_000)).all()


@pytest.mark.slow
def test_a_video_fires_as_its_pictures_do(tmp_path: Path) -> None:
    write_video(tmp_path / "clip.mp4", GREYS)
    with clsim.Simulator(screen(tmp_path, 'file = "clip.mp4"'), fps=200.0, threshold=0.25) as run:
        events = run.step(59_000)
    rises, falls = (int((events["on"] == on).sum()) for on in (True, False))
    (up, _, _), (down, _, _) = expected(0.25)[:2]
    assert rises == pytest.approx(up * 16 * 12, abs=192) and falls == pytest.approx(down * 16 * 12, abs=192)


@pytest.mark.slow
def test_with_adaptive_time_a_screen_fires_as_its_pictures_change(tmp_path: Path) -> None:
    """Its jumps are timed to the 60 frames a second that a film of 50 asks for."""
    with clsim.Simulator(screen(tmp_path), threshold=0.25, time="adaptive") as run:
        events = run.step(99_000)
    own = events[(events["x"] == 5) & (events["y"] == 7)]
    assert own["on"].tolist() == [up for steps, up, _ in expected(0.25) for _ in range(steps)]
    shown_us = np.repeat([k * 20_000 for *_, k in expected(0.25)], [steps for steps, *_ in expected(0.25)])
    assert np.abs(own["t"] - shown_us).max() <= 1e6 / 60


def test_too_few_frames_are_told(tmp_path: Path) -> None:
    with clsim.Simulator(screen(tmp_path), fps=30.0) as run:
        (warning,) = run.warnings
    assert "the light of screen changes too fast for 30 frames" in warning and "at least 50" in warning
    assert base_fps(clsim.load_scene(screen(tmp_path))) == 60.0
