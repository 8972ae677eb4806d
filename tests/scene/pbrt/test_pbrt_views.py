"""What of a scene pbrt's films and cameras show: crops, windows and pixels that are not square."""

import math
from itertools import pairwise

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.live.outputs.sidecars import about_camera
from tests.scene.pbrt.test_pbrt import TRIANGLE, load

WIDTH, HEIGHT, FOV_DEG = 400, 200, 40.0
POINTS = ((0.0, 0.0), (0.4, 0.3), (-0.2, -0.5))


def head(film="", camera="", kind="perspective"):
    return (
        f'LookAt 0 0 -5  0 0 0  0 1 0\nCamera "{kind}" "float fov" {FOV_DEG} {camera}\n'
        f'Film "rgb" "integer xresolution" {WIDTH} "integer yresolution" {HEIGHT} {film}\n'
    )


def raster(x, y, window, kind):
    """Return the pixel of pbrt's whole film where a point at z = 0 appears (Physically Based Rendering, 5.2)."""
    left, right, bottom, top = window
    scale = 5 * math.tan(math.radians(FOV_DEG / 2)) if kind == "perspective" else 1.0
    return (x / scale - left) / (right - left) * WIDTH, (top - y / scale) / (top - bottom) * HEIGHT


def pixel(camera, x, y):
    """Return the pixel where clsim's camera sees the same point."""
    about = about_camera(camera)
    a, b, c, _ = np.linalg.inv(camera.motion.pose(0.0)) @ (x, y, 0.0, 1.0)
    if about["model"] == "orthographic":
        scale, centre, depth = about["pixels_per_m"], about["axis_px"], 1.0
        return centre["cx"] + scale["x"] * a / depth, centre["cy"] - scale["y"] * b / depth
    k = about["intrinsics_px"]
    return k["cx"] + k["fx"] * a / -c, k["cy"] - k["fy"] * b / -c


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    ("camera", "window"),
    [
        ("", (-2, 2, -1, 1)),
        ('"float screenwindow" [-1 1.5 -0.25 1]', (-1, 1.5, -0.25, 1)),
        ('"float screenwindow" [-1 1 -1 1]', (-1, 1, -1, 1)),
        ('"float frameaspectratio" 0.5', (-1, 1, -2, 2)),
    ],
)
@pytest.mark.parametrize(
    ("film", "start", "size"),
    [
        ("", (0, 0), (400, 200)),
        ('"float cropwindow" [0.1 0.8 0.25 0.5]', (40, 50), (280, 50)),
        ('"integer pixelbounds" [100 150 20 190]', (100, 20), (50, 170)),
        ('"integer pixelbounds" [0 400 -9 100] "float cropwindow" [0 0.5 0 0.5]', (0, 0), (400, 100)),
    ],
)
def test_crops_and_windows_show_what_pbrt_shows(tmp_path, film, start, size, camera, window, kind):
    world = load(tmp_path, TRIANGLE, head(film, camera, kind))
    assert (world.camera.width, world.camera.height) == size
    assert world.warnings == ()
    for x, y in POINTS:
        expected = np.subtract(raster(x, y, window, kind), start)
        np.testing.assert_allclose(pixel(world.camera, x, y), expected, atol=1e-6)


@pytest.mark.parametrize("part", range(7))
def test_a_pixel_is_in_the_crop_window_that_holds_its_left_and_upper_edge(tmp_path, part):
    """Products are in 32 bits, as pbrt's: .3 of 400 is more than 120 there, .55 is 220. Windows side by side tile."""
    shares = sorted({k / 100 for k in range(part, 101, 7)} | {0.0, 1.0, 0.1234 + part / 11})
    whole = load(tmp_path, TRIANGLE, head()).camera
    edges = [[], []]
    for first, last in pairwise(shares):
        film = f'"float cropwindow" [{first!r} {last!r} {first!r} {last!r}]'
        camera = load(tmp_path, TRIANGLE, head(film)).camera
        starts = np.rint(np.subtract(pixel(whole, 0.4, 0.3), pixel(camera, 0.4, 0.3))).astype(int)
        for found, start, size in zip(edges, starts.tolist(), (camera.width, camera.height), strict=True):
            assert start == (found[-1] if found else 0)
            found += [start, start + size] if not found else [start + size]
    for found, size in zip(edges, (WIDTH, HEIGHT), strict=True):
        assert found == np.ceil(np.float32(shares) * np.float32(size)).astype(int).tolist()


@pytest.mark.parametrize(
    ("film", "camera", "part"),
    [
        ('"float cropwindow" [0.5 0.5 0 1]', "", "cropwindow leaves no pixel of 400×200"),
        ('"float cropwindow" [0 1 0]', "", "cropwindow has 3 numbers, expected four"),
        ('"integer pixelbounds" [500 600 0 9]', "", "pixelbounds leaves no pixel"),
        ("", '"float screenwindow" [1 -1 -1 1]', "screenwindow is empty"),
        ("", '"float frameaspectratio" -1', "frameaspectratio is -1"),
    ],
)
def test_windows_that_show_nothing_are_refused(tmp_path, film, camera, part):
    with pytest.raises(InputError, match=part):
        load(tmp_path, TRIANGLE, head(film, camera))
