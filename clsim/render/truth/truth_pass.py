"""Truth of a view: a pass of its own over the pixels' centres, so that the path tracer's kernels know nothing of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.frames.planes import PlaneSet
from clsim.render.camera.camera import CameraData
from clsim.render.device.arrays import array
from clsim.render.device.launch import record
from clsim.render.features.features import view_features
from clsim.render.scene_data import SceneData
from clsim.render.truth.truth_rays import Objects, TruthHit, build_truth, truth_features
from clsim.scene import Camera

FLOWS = ("Flow.forward", "Flow.backward", "Label.flow")
"""The planes that lead to another time."""


class TruthPass:
    """Fills the planes of truth of a frame: one ray a pixel, and one more for each way of flow.

    The rays go through the pixels' centres at the frame's very time, whatever the exposure and the aperture. A surface
    counts where its opacity is at least one half; mirrors and glass count as themselves.

    Attributes:
        labels: whether events are to be labelled, for which all frames count.
    """

    def __init__(self, data: SceneData, camera: Camera, planes: PlaneSet) -> None:
        """Build the kernels for the planes of truth among ``planes``, which are those of the frames to come."""
        sharp = replace(camera, shutter_s=0.0, lens=replace(camera.lens, aperture_radius_m=0.0))
        own = PlaneSet((), (), planes.truth)
        features = truth_features(view_features(data.features, sharp), own)
        trace_centres, follow = build_truth(features, own, data.tree)
        self._data = data
        self._camera = CameraData(sharp, features, data.origin_m, data.device)
        self._first_row = planes.first(planes.truth[0].name)
        names = [plane.name for plane in planes.truth]
        self._flow_rows = {name: own.first(name) for name in FLOWS if name in names}
        self.labels = "Label.flow" in names
        pixels = camera.width * camera.height
        self._planes: Any = wp.zeros((len(own.names), pixels), dtype=wp.float32, device=data.device)
        hits = wp.zeros(pixels, dtype=TruthHit, device=data.device)
        objects = Objects()
        objects.of_instance = array(data.instance_objects, wp.int32, data.device)
        objects.of_triangle = array(data.triangle_objects, wp.int32, data.device)
        objects.count = len(data.world.instances)
        shared = {"scene": data.scene, "camera": self._camera.at(0.0), "width": camera.width, "first_pixel": 0}
        self._trace_centres = record(
            trace_centres, pixels, data.device, objects=objects, out_hits=hits, out_planes=self._planes, **shared
        )
        self._follow: Any = None
        if self._flow_rows:
            self._follow = record(
                follow,
                pixels,
                data.device,
                hits=hits,
                height=camera.height,
                row=0,
                scale=1.0,
                out_planes=self._planes,
                **shared,
            )

    def fill(self, out_planes: npt.NDArray[np.float32], time_us: int, ends_us: Mapping[str, int | None]) -> None:
        """Write truth at ``time_us`` into the frame's planes ``[C, H, W]``.

        ``ends_us`` holds the time to which each plane of flow leads; where that is None the flow is not valid, and a
        plane that is not among them stays as it was. The scene is left at one of these times.
        """
        self._launch(self._trace_centres, time_us)
        for name, row in self._flow_rows.items():
            if name not in ends_us:
                continue
            end_us = ends_us[name]
            if end_us is None:
                self._planes[row : row + 4].zero_()
                continue
            self._follow.set_param_by_name("row", row)
            self._follow.set_param_by_name("scale", 1e6 / (end_us - time_us) if name == "Label.flow" else 1.0)
            self._launch(self._follow, end_us)
        truth: npt.NDArray[np.float32] = self._planes.numpy()
        out_planes[self._first_row : self._first_row + len(truth)] = truth.reshape(len(truth), *out_planes.shape[1:])

    def _launch(self, launch: Any, time_us: int) -> None:
        time_s = time_us * 1e-6
        self._data.move(time_s)
        launch.set_param_by_name("camera", self._camera.at(time_s))
        launch.launch()
        wp.synchronize_device(self._data.device)
