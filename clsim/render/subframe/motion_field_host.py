"""Host side of motion_field.py: where surfaces go on the image in a step of time."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.render.camera.camera import CameraData
from clsim.render.camera.pixel_width import pixel_of, widest_pixel
from clsim.render.device.arrays import write
from clsim.render.device.launch import Threads, Tiles, record
from clsim.render.features.features import Features
from clsim.render.scene_data import SceneData
from clsim.render.subframe.motion_field import build_motion_field, build_pass_over
from clsim.render.view import RenderCancelled

_PLACES = ((0.5, 0.5), (0.125, 0.625), (0.375, 0.125), (0.625, 0.875), (0.875, 0.375))
"""Where rays pass through a pixel: its middle, and where objects move, so that no thin one is missed."""
_POSES_REMEMBERED = 4
"""Camera poses of which the places seen are remembered: the ends of a step and its middle, and none."""


class MotionFieldHost:
    """Finds the motion field between two instants, by few rays: where the camera stands, only what moves is met."""

    def __init__(
        self,
        data: SceneData,
        features: Features,
        camera: CameraData,
        settings: Any,
        shape: tuple[int, int],
        threads: Threads,
    ) -> None:
        """Build the kernels, and make room for all rays.

        Args:
            data: what moves, with a place for each of several instants.
            features: what kernels are built for.
            camera: where the camera is at instants.
            settings: the `Settings` of the pictures.
            shape: rows and columns of these.
            threads: that trace.
        """
        self._data, self._camera, self._settings, self._shape = data, camera, settings, shape
        view = data.world.camera
        self._pixel_rad, self._pixel_m = pixel_of(view)
        if self._pixel_rad > 0.0:
            self._pixel_rad = widest_pixel(view)
        device = data.device
        # Where the camera alone moves, neighbours go alike.
        self._spacing = spacing = 2 if data.still else 1
        self._blocks = rows, columns = -(-shape[0] // spacing), -(-shape[1] // spacing)
        self._at: Any = wp.array(_PLACES if features.instants else _PLACES[:1], dtype=wp.vec2, device=device)
        self._ways: Any = wp.zeros((2, len(self._at), rows * columns), dtype=wp.vec2, device=device)
        self._longest: Any = wp.zeros(rows * columns, dtype=wp.int64, device=device)
        self._places_by_pose: dict[bytes | None, Any] = {}
        boxes = max(1, len(data.moving_boxes()[0]))
        self._corners: list[Any] = [wp.zeros(boxes, dtype=wp.vec3, device=device) for _ in range(2)]
        self._near_moving: Any = wp.Bvh(*self._corners)
        self._kernel = build_motion_field(features, data.tree)
        self._follow = Tiles(threads, self._record, "first", rows * columns, None, "count")
        self._spread = wp.launch(
            build_pass_over(),
            dim=(2 * len(self._at), rows * columns),
            inputs=[self._ways.reshape((-1, rows * columns)), columns, rows, float(spacing), self._longest],
            device=device,
            record_cmd=True,
        )

    def ways(self, start_s: float, end_s: float) -> npt.NDArray[np.float32]:
        """Return the motion field from one time [s] to another, ``[3, 2, H, W]``; see `Retracer.motion`.

        Raises:
            RenderCancelled: the threads were cancelled, before or meanwhile.
        """
        instants_s = np.array([start_s, end_s])
        self._data.move_to(instants_s)
        self._enclose(instants_s)
        keys = [self._camera.pose_key(time_s) for time_s in instants_s.tolist()]
        changed = {"camera": self._camera.at_instants(instants_s), "scene": self._data.scene}
        changed["stands"] = keys[0] == keys[1] and not self._data.still
        for k in (0, 1):
            key = keys[k] if self._spacing > 1 else None
            changed |= {"start": k, "seen": key is not None and key in self._places_by_pose}
            changed |= {"places": self._places_seen_from(key), "out_ways": self._ways[k]}
            if not self._follow.run(self._blocks[0] * self._blocks[1], changed):
                raise RenderCancelled
        self._longest.zero_()
        self._spread.launch()
        (height, width), (rows, columns) = self._shape, self._blocks
        found = self._ways.numpy()
        found[1] *= -1.0  # from what is seen at the end, back
        longest = _largest_around(self._longest.numpy().reshape(rows, columns)).ravel()
        over = found.reshape(-1, 2)[longest & 0xFFFFFFFF]
        over[longest < 1 << 32] = 0.0
        result = np.stack([*found[:, 0], over]).transpose(0, 2, 1).reshape(3, 2, rows, columns)
        if self._spacing > 1:
            result = result.repeat(self._spacing, axis=2).repeat(self._spacing, axis=3)
        return np.ascontiguousarray(result[:, :, :height, :width])

    def _enclose(self, instants_s: npt.NDArray[np.float64]) -> None:
        """Put boxes around what moves, as much larger as a pixel is wide there, from both instants' camera."""
        lowers, uppers = self._data.moving_boxes()
        if len(lowers):
            poses = [self._data.world.camera.motion.pose(time_s) for time_s in instants_s.tolist()]
            places = np.array(poses)[:, None, :3, 3] - self._data.origin_m
            farthest = np.maximum(np.abs(places - lowers), np.abs(places - uppers)).max(axis=0)
            wide_m = self._pixel_m + self._pixel_rad * np.linalg.norm(farthest, axis=1, keepdims=True)
            write(self._corners[0], (lowers - wide_m).astype(np.float32))
            write(self._corners[1], (uppers + wide_m).astype(np.float32))
            self._near_moving.rebuild()

    def _places_seen_from(self, pose_key: bytes | None) -> Any:
        """Return the array of places seen from a camera pose, where all else rests; None remembers nothing."""
        places = self._places_by_pose.pop(pose_key, None)
        if places is None and len(self._places_by_pose) >= _POSES_REMEMBERED:
            places = self._places_by_pose.pop(next(iter(self._places_by_pose)))
        if places is None:
            places = wp.zeros(self._ways.shape[2], dtype=wp.vec4, device=self._data.device)
        self._places_by_pose[pose_key] = places
        return places

    def _record(self, tile: int) -> Any:
        return record(
            self._kernel,
            tile,
            self._data.device,
            scene=self._data.scene,
            camera=self._camera.at_instants(np.zeros(2)),
            settings=self._settings,
            first=0,
            count=1,
            spacing=self._spacing,
            start=0,
            at=self._at,
            stands=False,
            near_moving=self._near_moving.id,
            seen=False,
            places=self._places_seen_from(None),
            out_ways=self._ways[0],
        )


def _largest_around(values: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the largest value of each pixel and its eight neighbours, ``[H, W]``."""
    padded = np.pad(values, 1)
    rows = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    return np.maximum(np.maximum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
