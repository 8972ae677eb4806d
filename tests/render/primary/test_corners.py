"""What the corners of a pixel tell of places between them: in closed form."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from clsim.render.camera.film import Sample
from clsim.render.primary.corners import between_corners

PIXEL = 0.1


@wp.kernel(enable_backward=False)
def meet_between(
    corners: wp.array[Sample], directions: wp.array[wp.vec3], normal: wp.vec3, place: wp.vec2, out: wp.array[wp.vec3]
):
    for i in range(4):
        met = directions[i] * (-1.0 / wp.dot(directions[i], normal))
        corners[i].position = met
        corners[i].depth = wp.length(met)
        corners[i].normal = normal
        corners[i].facing = normal
        corners[i].reach_m = 1.0
    out[0] = between_corners(corners, 0, 2, place, wp.vec2(0.1, 0.1)).position


@given(st.floats(0, 1), st.floats(0, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_corners_tell_where_a_ray_between_them_meets_their_triangle(x, y, tilt_x, tilt_y):
    """Exactly in its plane, and a fiftieth of a pixel beside a pinhole's ray at most, of pixels six degrees wide."""
    normal = np.array([tilt_x, tilt_y, 1.0])
    ways = np.array([(0.2 + PIXEL * (i & 1), -0.3 + PIXEL * (i // 2), -1.0) for i in range(4)])
    corners, out = wp.zeros(4, dtype=Sample, device="cpu"), wp.zeros(1, dtype=wp.vec3, device="cpu")
    directions = wp.array(ways.astype(np.float32), dtype=wp.vec3, device="cpu")
    wp.launch(meet_between, 1, [corners, directions, wp.vec3(*normal), wp.vec2(x, y), out], device="cpu")
    toward = np.array([0.2 + PIXEL * x, -0.3 + PIXEL * y, -1.0])
    met = toward * (-1.0 / (toward @ normal))
    assert out.numpy()[0] @ normal == pytest.approx(-1.0, abs=1e-5)
    np.testing.assert_allclose(out.numpy()[0], met, rtol=0, atol=0.02 * PIXEL * np.linalg.norm(met))
