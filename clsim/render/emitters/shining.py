"""The radiance of lights at a time: what they were given, times how they change, in the kernels' arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from clsim.scene import ImageTexture, World
from clsim.scene.modulation import Modulation
from clsim.scene.motion import euler_quaternion, rotation_matrix
from clsim.scene.world import Vec3

_F64 = npt.NDArray[np.float64]


class Shining:
    """The light of lamps, surfaces and the sky, written to a device when it changes.

    Which light is drawn how often stays as it is: what is found is weighted by it, and noise stays the same from frame
    to frame.

    Attributes:
        state: all factors, and how far the sky has turned; another one where the light is another.
    """

    def __init__(self, world: World, lights: Any, materials: Any) -> None:
        """Take the light as it is in the world, at time 0, for the arrays of ``lights`` and ``materials``."""
        self._lights, self._materials = lights, materials
        self._groups = [
            _Group([(each.name, each.radiance, each.modulation) for each in world.sphere_lights], self._light_spheres),
            _Group(
                [(each.name, each.intensity, each.modulation) for each in world.punctual_lights], self._light_points
            ),
            _Group([(each.name, each.emission, each.modulation) for each in world.materials], self._light_surfaces),
            _Group([("", world.environment, world.environment_modulation)], self._light_sky),
        ]
        self._films = _Films(world, materials)
        self._map = world.environment_map
        self._constant = np.array(world.environment, np.float32)
        self.state: _F64 = np.zeros(0)
        self._changes = world.light_changes()
        self.shine(0.0, 0.0)

    def set(self, name: str, radiance: Vec3) -> None:
        """Give what is called so another radiance; its changes with time go on."""
        for group in self._groups:
            group.set(name, radiance)

    def shine(self, start_s: float, end_s: float) -> None:
        """Let all shine as it does on average from one time to another [s]; where both are one, as it does then."""
        if not self._changes:
            return
        factors = [group.factors(start_s, end_s) for group in self._groups]
        turned = 0.0 if self._map is None else self._map.turn_deg_per_s * 0.5 * (start_s + end_s) % 360.0
        state = np.concatenate([*(each.ravel() for each in factors), [turned], self._films.find(start_s, end_s)])
        if np.array_equal(state, self.state):
            return
        self.state = state
        for group, each in zip(self._groups, factors, strict=True):
            group.shine(each)
        self._films.show()
        if self._map is not None and self._map.turn_deg_per_s:
            turn = rotation_matrix(euler_quaternion((0.0, turned, 0.0))) @ np.asarray(self._map.to_world, np.float64)
            self._lights.environment_image.to_world = wp.mat33(*turn.ravel())

    def _light_spheres(self, radiance: _F64) -> None:
        self._lights.sphere_radiance.assign(radiance.astype(np.float32))

    def _light_points(self, intensity: _F64) -> None:
        self._lights.punctual.intensity.assign(intensity.astype(np.float32))

    def _light_surfaces(self, emission: _F64) -> None:
        rows = self._materials.rows.numpy()
        rows["emission"] = emission
        self._materials.rows.assign(rows)

    def _light_sky(self, radiance: _F64) -> None:
        self._lights.environment = wp.vec3(*radiance[0])
        if self._map is not None:
            factors = self._groups[-1].now[0].astype(np.float32)
            self._lights.environment_image.radiance.assign((self._map.radiance + self._constant) * factors)


class _Films:
    """Textures whose pictures change with time."""

    def __init__(self, world: World, materials: Any) -> None:
        """Find them among a world's textures; their texels are written in place."""
        self._texels = materials.textures.texels
        firsts = materials.textures.rows.numpy()["first"]
        found = [(texture, int(first)) for texture, first in zip(world.textures, firsts, strict=False) if first >= 0]
        self._films = [
            (texture.film, first) for texture, first in found if isinstance(texture, ImageTexture) and texture.film
        ]
        self._shown: list[list[tuple[int, float]]] = [[(0, 1.0)]] * len(self._films)
        self._next = self._shown

    def find(self, start_s: float, end_s: float) -> _F64:
        """Return which pictures are shown in a time, and for how much of it: another array where they are others."""
        self._next = [film.shown(start_s, end_s) for film, _ in self._films]
        return np.array([part for shown in self._next for pair in shown for part in pair], np.float64)

    def show(self) -> None:
        """Write the pictures that were found last, where others are shown."""
        for (film, first), before, now in zip(self._films, self._shown, self._next, strict=True):
            if now != before:
                texels = np.ascontiguousarray(film.picture(now)).view("<u4").ravel()
                self._texels[first : first + len(texels)].assign(texels)
        self._shown = self._next


class _Group:
    """Lights of one sort.

    Attributes:
        now: the factors that they have, ``[n, 3]``.
    """

    def __init__(self, lights: Sequence[tuple[str, Vec3, Modulation | None]], write: Any) -> None:
        self._names = [name for name, _, _ in lights]
        self._radiance = np.array([radiance for _, radiance, _ in lights], np.float64).reshape(-1, 3)
        self._changes = [(i, change) for i, (_, _, change) in enumerate(lights) if change is not None]
        self._write = write
        self.now = np.ones_like(self._radiance)

    def set(self, name: str, radiance: Vec3) -> None:
        """Give those of a name another radiance."""
        named = [own == name for own in self._names]
        if name and any(named):
            self._radiance[named] = radiance
            self._write(self._radiance * self.now)

    def factors(self, start_s: float, end_s: float) -> _F64:
        """Return the mean factors over a time, ``[changing, 3]``."""
        return np.array([change.mean(start_s, end_s) for _, change in self._changes], np.float64).reshape(-1, 3)

    def shine(self, factors: _F64) -> None:
        """Write what has those factors."""
        if self._changes:
            self.now[[i for i, _ in self._changes]] = factors
            self._write(self._radiance * self.now)
