"""Host side of flat_pixels.py: the light of pixels that show one flat surface, at any time of a step."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.frames import Fineness, Reflected
from clsim.render.device.launch import Threads, Tiles, record, tile_size
from clsim.render.subframe.flat_pixels import INSTANTS, MOST_KNOTS

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]


class FlatFollower:
    """Follows pixels that show one flat surface, while the camera alone moves."""

    def __init__(
        self,
        kernels: tuple[Any, Any, Any],
        shape: tuple[int, int],
        arguments: dict[str, Any],
        device: Any,
        threads: Threads,
    ) -> None:
        """Allocate what is known of corners.

        Args:
            kernels: of `build_flat_pixels`.
            shape: height and width of the picture.
            arguments: what kernels take by these names: ``scene``, ``settings``, ``camera`` and ``corners``.
            device: Warp's device.
            threads: that follow.
        """
        self._height, self._width = shape
        self._device, rows = device, self._height + 1
        corners, pixels = rows * (self._width + 1), self._height * self._width
        self._bounds: Any = wp.zeros(corners, dtype=wp.uint8, device=device)
        self._places: Any = wp.zeros((corners, INSTANTS), dtype=wp.vec3, device=device)
        seen = {name: arguments[name] for name in ("settings", "corners")} | {"first": 0, "count": 1}
        scene, camera = ({name: arguments[name]} for name in ("scene", "camera"))
        self._counts: Any = wp.empty(pixels, dtype=wp.int32, device=device)
        self._knots: Any = wp.empty((pixels, MOST_KNOTS), dtype=wp.vec2, device=device)
        listed: Any = wp.zeros(1, dtype=wp.int32, device=device)
        light: Any = wp.zeros((6, 1), dtype=wp.float32, device=device)

        def tiles(most: int, kernel: Any, **more: Any) -> Tiles:
            size = tile_size(1, device)
            return Tiles(
                threads, lambda tile: record(kernel, tile, device, **seen, **more), "first", most, size, "count"
            )

        bound, place, follow = kernels
        self._bound = tiles(corners, bound, **scene, rows=rows, out_bounds=self._bounds)
        self._place = tiles(corners, place, **camera, rows=rows, bounds=self._bounds, out_places=self._places)
        self._follow = tiles(
            pixels, follow, **scene, places=self._places, pixels=listed, light=light, texels=1,
            out_counts=self._counts, out_knots=self._knots, **asdict(Fineness(0.0, 0.0, 1.0, 1.0, True)),
        )  # fmt: skip

    def bounds(self, corners: Any) -> npt.NDArray[np.bool_]:
        """Return where more is seen than one flat surface whose albedo its texture tells, ``[H, W]``.

        ``corners`` is what rays at the corners of pixels saw.
        """
        self._bound.run(len(self._bounds), {"corners": corners})
        found = self._bounds.numpy().reshape(self._height + 1, self._width + 1) != 0
        bounds: npt.NDArray[np.bool_] = found[:-1, :-1] | found[:-1, 1:] | found[1:, :-1] | found[1:, 1:]
        return bounds

    def reflected(
        self, pixels: I64, light: F32, corners: Any, camera: Any, texels: int, fineness: Fineness
    ) -> Reflected:
        """Return what pixels reflect that are not on `bounds`, the last ones asked for; see `PixelTracer.reflected`.

        ``camera`` has its poses at `INSTANTS` of the step; ``texels`` tells how many places of a texture are looked up.
        """
        self._place.run(len(self._bounds), {"corners": corners, "camera": camera})
        listed: Any = wp.array(pixels, dtype=wp.int32, device=self._device)
        host: Any = wp.array(light, dtype=wp.float32, device="cpu", copy=False)
        lit = host.to(self._device)
        changed = {"corners": corners, "pixels": listed, "light": lit, "texels": texels}
        self._follow.run(len(pixels), changed | asdict(fineness))
        found = self._counts.numpy()[: len(pixels)]
        changing = np.flatnonzero(found > 0)
        firsts = np.concatenate([[0], np.cumsum(found[changing])])
        skipped = changing * MOST_KNOTS - firsts[:-1]
        told = self._knots.numpy().reshape(-1, 2)[np.repeat(skipped, found[changing]) + np.arange(firsts[-1])]
        return Reflected(pixels[found >= 0], pixels[changing], firsts, told[:, 0], told[:, 1])
