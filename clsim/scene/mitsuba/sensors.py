"""Mitsuba's sensors as cameras: perspective, with a thin lens or a distorted image, and orthographic."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from clsim.errors import InputError
from clsim.scene.mitsuba.places import ahead, start_of
from clsim.scene.mitsuba.values import numbers
from clsim.scene.mitsuba.xml import Plugin
from clsim.scene.rigid import mirrors
from clsim.scene.world import Camera, Lens

FULL_FRAME_MM = (36.0, 24.0)
FAR_CLIP = 10_000.0
"""As far as Mitsuba's cameras see unless told, and where a lens is sharp then."""


def read_sensor(sensor: Plugin) -> Camera:
    """Return a sensor's camera, which renders what its film's crop window leaves.

    Raises:
        InputError: with file and line, if the film has no pixel or the field of view is none.
    """
    film = next(iter(sensor.of_kind("film")), None)
    width, height = 768, 576
    if film is not None:
        width, height = int(film.get("width", 768.0)), int(film.get("height", 576.0))
    if min(width, height) < 1:
        raise InputError(f"{sensor.place}: the film is {width}×{height}, expected at least one pixel")
    if sensor.type == "orthographic":
        camera = _orthographic(sensor, width, height)
    else:
        camera = Camera(
            width,
            height,
            _fov_deg(sensor, width, height),
            ahead(sensor),
            _exposure_s(sensor),
            _lens(sensor, width, height),
        )
    return camera if film is None else _cropped(camera, film)


def _lens(sensor: Plugin, width: int, height: int) -> Lens:
    thin = sensor.type == "thinlens"
    distortion: tuple[float, ...] = ()
    if sensor.type == "perspective_rdist" and sensor.get("kc", ""):
        distortion = tuple(numbers(sensor.place, sensor.get("kc", ""), (2,)))
    return Lens(
        aperture_radius_m=sensor.get("aperture_radius", 0.0) if thin else 0.0,
        focus_distance_m=sensor.get("focus_distance", sensor.get("far_clip", FAR_CLIP)) if thin else 1.0,
        distortion=distortion,
        # Mitsuba shifts the film, clsim the optical centre upon it.
        principal_point=(
            -sensor.get("principal_point_offset_x", 0.0),
            -sensor.get("principal_point_offset_y", 0.0) * height / width,
        ),
        mirrored=mirrors(start_of(sensor)),
    )


def _cropped(camera: Camera, film: Plugin) -> Camera:
    """Return a camera that renders the crop window of its film, if there is one."""
    names = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
    whole = (0, 0, camera.width, camera.height)
    x, y, width, height = (int(film.get(name, float(n))) for name, n in zip(names, whole, strict=True))
    if (x, y, width, height) == whole:
        return camera
    if min(x, y) < 0 or min(width, height) < 1 or x + width > camera.width or y + height > camera.height:
        raise InputError(
            f"{film.place}: the crop window is {width}×{height} at {x}, {y}, expected a part of "
            f"{camera.width}×{camera.height}"
        )
    lens, share = camera.lens, width / camera.width
    across = camera.width * (0.5 + lens.principal_point[0]) - x
    down = camera.height / 2 + camera.width * lens.principal_point[1] - y
    lens = replace(
        lens,
        principal_point=(across / width - 0.5, (down - height / 2) / width),
        view_width_m=lens.view_width_m * share,
    )
    fov_deg = 2 * math.degrees(math.atan(math.tan(math.radians(camera.fov_deg / 2)) * share))
    return replace(camera, width=width, height=height, fov_deg=fov_deg, lens=lens)


def _orthographic(sensor: Plugin, width: int, height: int) -> Camera:
    """Return a camera of parallel rays, which sees from −1 to 1 along its own x, whatever its place makes of that."""
    # It shows a square of its film, stretched where the place is scaled unevenly.
    across, up = np.linalg.norm(start_of(sensor)[:3, :2], axis=0)
    lens = Lens(model="orthographic", mirrored=mirrors(start_of(sensor)), view_width_m=2 * float(across))
    lens = replace(lens, aspect=float(up / across) if across > 0 else 1.0)
    return Camera(width, height, 45.0, ahead(sensor), _exposure_s(sensor), lens)


def _exposure_s(sensor: Plugin) -> float:
    return max(float(sensor.get("shutter_close", 0.0) - sensor.get("shutter_open", 0.0)), 0.0)


def _fov_deg(sensor: Plugin, width: int, height: int) -> float:
    """Return the horizontal field of view; Mitsuba's may be given along another side or as a focal length."""
    axis = sensor.get("fov_axis", "x").lower()
    fov = sensor.get("fov", 0.0)
    if "fov" not in sensor.values:
        text = sensor.get("focal_length", "50mm").lower().removesuffix("mm")
        try:
            focal_mm = float(text)
        except ValueError:
            raise InputError(f"{sensor.place}: focal_length is {text!r}, expected millimetres such as 50mm") from None
        if not focal_mm > 0:
            raise InputError(f"{sensor.place}: focal_length is {focal_mm:g} mm, expected more than 0")
        fov, axis = 2 * math.degrees(math.atan(math.hypot(*FULL_FRAME_MM) / 2 / focal_mm)), "diagonal"
    if not 0 < fov < 180:
        raise InputError(f"{sensor.place}: fov is {fov:g}, expected more than 0 and less than 180")
    if axis in ("smaller", "larger"):
        axis = "x" if (axis == "larger") == (width >= height) else "y"
    sides = {"x": width, "y": height, "diagonal": math.hypot(width, height)}
    if axis not in sides:
        raise InputError(f"{sensor.place}: fov_axis is {axis!r}, expected x, y, diagonal, smaller or larger")
    return 2 * math.degrees(math.atan(math.tan(math.radians(fov / 2)) * width / sides[axis]))
