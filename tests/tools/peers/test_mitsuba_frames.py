"""Mitsuba's frames against ours: the same scene from the same camera, wherever it has moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clsim.frames import ALBEDO, RADIANCE, Frame, FrameSource
from clsim.render import PathTracer, RenderOptions
from clsim.scene import load_world
from tools.peers.mitsuba_frames import MitsubaFrames

ROOM = Path(__file__).resolve().parents[3].parent / "shared" / "assets" / "mitsuba" / "living-room" / "scene.xml"
WIDTH, HEIGHT, SPP = 32, 24, 1024


def rendered(source: FrameSource, index: int) -> Frame:
    frame = Frame(np.zeros((len(source.names), HEIGHT, WIDTH), np.float32), source.names)
    source.fill(index, frame)
    return frame


def blocks(plane: np.ndarray) -> np.ndarray:
    """Return the means of 8×8 pixels."""
    return plane.reshape(HEIGHT // 8, 8, WIDTH // 8, 8).mean(axis=(1, 3))


@pytest.mark.oracle
@pytest.mark.usefixtures("llvm_mitsuba")
@pytest.mark.parametrize("scene", ["two-boxes", "moving-light", "cornell", ROOM], ids=lambda scene: Path(scene).stem)
def test_both_render_the_same(scene: str | Path) -> None:
    """Means of blocks agree within the noise, late in the motion, so that a thing left behind would show.

    Mitsuba's features are means over all samples, ours over those that hit, and the albedo of what is glossy is a
    matter of taste.
    """
    file = scene if isinstance(scene, Path) else None
    if file is not None and not file.exists():
        pytest.skip("the real scenes are not beside this checkout")
    world = load_world(scene, resolution=(WIDTH, HEIGHT))
    options = RenderOptions(spp=SPP, frames=48, follow_specular=False)
    tracer, peer = PathTracer(world, options), MitsubaFrames(world, file, options)
    ours, theirs = rendered(tracer, 47), rendered(peer, 47)
    tracer.close()
    assert theirs.time_us == ours.time_us
    coverage = ours.plane("Coverage")
    for name in theirs.names:
        radiance = name in RADIANCE
        mine = ours.plane(name) * (1.0 if radiance else coverage)
        if name in ALBEDO and not file:
            assert np.abs(mine - theirs.plane(name)).mean() < 0.01, "a pattern lies elsewhere"
        a, b = blocks(mine), blocks(theirs.plane(name))
        scale = a + 0.05 * a.mean() if radiance else max(1.0, a.max())
        worst = (np.abs(a - b) / scale).max()
        limit = 0.12 if radiance else 0.15 if name in ALBEDO and file else 0.05
        assert worst < limit, f"{name} is off by {worst:.3f}"
