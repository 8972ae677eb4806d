"""Intrinsics as data sets tell them: OpenCV counts pixels from the first one's centre, clsim from its corner."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from clsim.errors import InputError

_DISTORTION = {"perspective": ("k1", "k2", "p1", "p2", "k3"), "fisheye": ("k1", "k2", "k3", "k4")}


def opencv_numbers(camera: Mapping[str, Any]) -> tuple[list[float], list[float]]:
    """Return fx, fy, cx, cy and the coefficients of distortion, as OpenCV takes them for the camera's model.

    Raises:
        InputError: they are not known.
    """
    if camera.get("model") == "orthographic":
        raise InputError("this layout needs intrinsics as OpenCV has them, and an orthographic camera has none")
    try:
        px, distortion = camera["intrinsics_px"], camera["distortion"]
        keys = _DISTORTION[camera["model"]]
        return [px["fx"], px["fy"], px["cx"] - 0.5, px["cy"] - 0.5], [float(distortion[key]) for key in keys]
    except (KeyError, TypeError, ValueError):
        raise InputError("this layout needs the camera's intrinsics, but the recording does not tell them") from None


def yaml_numbers(text: str, key: str) -> list[float]:
    """Return the numbers of a list, or of nested ones, under a key of a YAML file, in either of its styles."""
    found = re.search(rf"^[ \t]*{key}:([\s\d.eE+,\[\]-]*)", text, re.MULTILINE)
    return [] if found is None else [float(word) for word in re.findall(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?", found[1])]


def camera_of(
    size: tuple[int, int], matrix: Sequence[float], coefficients: Sequence[float], *, fisheye: bool = False
) -> dict[str, Any]:
    """Return a camera as sidecars describe it, from OpenCV's fx, fy, cx, cy and coefficients of distortion."""
    fx, fy, cx, cy = matrix
    model = "fisheye" if fisheye else "perspective"
    keys = _DISTORTION[model]
    told = dict(zip(keys, coefficients, strict=False))
    return {
        "width": size[0],
        "height": size[1],
        "model": model,
        "intrinsics_px": {"fx": fx, "fy": fy, "cx": cx + 0.5, "cy": cy + 0.5},
        "distortion": dict.fromkeys(keys, 0.0) | told,
    }
