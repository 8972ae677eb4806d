"""A camera for rooms: from outside those that are closed show nothing but their walls, and open ones mostly so."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from clsim.scene.defaults.framing import RESOLUTION
from clsim.scene.motion import Keyframes, LookAtKeyframes, Quaternion, Static, compose, euler_quaternion
from clsim.scene.world import Camera, Instance, Mesh, SphereLight, Vec3

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

MAX_TRIANGLES = 300_000
"""Larger scenes are not looked into: it would take more than a second."""
ENCLOSED = 0.9
"""Share of the directions in which a wall's front must be seen for a place to be in a room."""
BARE = 0.5
"""Share of the directions in which a shell of single walls shows their backs to those outside."""
FLAT, SPACIOUS = 2 / 3, 0.2
"""In a room of thick walls: share of the directions in which a box's six planes are seen, and of all space that is."""
OPEN = 0.65
"""Share of the directions in which fronts are seen from the middle of a room that is open to one side."""
ONE_SIDE = 0.75
"""Length of the mean of the directions in which nothing is seen there: 1 were they all one."""
_LEVEL = 0.5
"""Sine of the angle by which that side may lie above or below; what is open upwards is a bowl."""
_NEARLY = 0.95
"""Cosine of the angle within which that side is taken for the one along x or z."""
_SWING_DEG = 15.0
_RAYS = 48
_PARALLEL, _SQUARE, _SAME_PLANE = 0.999, 0.05, 0.01
"""Cosines between planes that are parallel, at least, and at right angles, at most; how far apart, in diagonals of the
box, the same plane may seem."""
_SLACK = 1e-5
"""Of boxes in single precision, for rounding, in diagonals of all."""
_HEIGHTS = (0.4, 0.6)
_PLACES = (0.3, 0.5, 0.7)
"""Where to stand, in shares of the box around everything."""
_STRIDE, _LAMP, _LAMP_UP = 0.1, 0.1, 0.7
"""Radii of the camera's way and of the lamp, and how high it hangs over that, in ways to what is nearest."""
_LAMP_RADIANCE: Vec3 = (100.0, 96.0, 90.0)


def stand_inside(
    meshes: Sequence[Mesh], instances: Sequence[Instance], center: Vec3, size: F64, period_s: float
) -> tuple[Camera, SphereLight, str] | None:
    """Return a camera in a closed room that turns about its roomiest place, a lamp above it, and a note; else None.

    A place is in a room where nearly all ways lead to the fronts of faces: in a solid body they lead to backs. Hollow
    things have fronts within, too: a helmet, a bottle, a tube. They show fronts to the outside as well. So do rooms of
    thick walls, but they are wide, and their walls flat and at right angles, and there is no less to see in them than
    from outside: a van is no room. Into a room that is open to one side the camera looks from there.

    Args:
        meshes, instances: what stands there, as it stands at time 0.
        center: of the box around everything.
        size: of that box [m].
        period_s: time of a full turn.
    """
    if sum(len(meshes[instance.mesh].triangles) for instance in instances) > MAX_TRIANGLES:
        return None
    faces = _Faces(np.concatenate([_corners(meshes[instance.mesh], instance) for instance in instances]))
    middle = np.asarray(center)
    if opening := faces.opening(middle):
        side, room_m = opening
        camera, why = _looking_in(middle, size, side, period_s), "is a room: the camera looks in from its open side"
        return camera, _lamp_above(middle, room_m), why
    low = middle - size / 2
    places = [low + size * (right, up, ahead) for up in _HEIGHTS for right in _PLACES for ahead in _PLACES]
    rooms_m = faces.rooms_m(places)
    roomiest, best = max(rooms_m), places[int(np.argmax(rooms_m))]
    if roomiest == 0.0:
        return None
    camera = _turning(best, _STRIDE * roomiest, period_s)
    return camera, _lamp_above(best, roomiest), "is a closed room: the camera stands in it"


def _lamp_above(place: F64, room_m: float) -> SphereLight:
    above = place + np.array([0.0, _LAMP_UP * room_m, 0.0])
    return SphereLight(_LAMP * room_m, _LAMP_RADIANCE, Static(compose(above, np.eye(3))), "lamp")


def _corners(mesh: Mesh, instance: Instance) -> F64:
    pose = instance.motion.pose(0.0)
    points = mesh.vertices.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
    return np.asarray(points[mesh.triangles])


@dataclass
class _Seen:
    """What rays from a place have seen: fronts of faces, how far away, how often none, and how many were bare.

    ``outermost`` are the last faces in these directions, and ``nothing`` those in which there is none at all.
    """

    fronts: list[int] = field(default_factory=list)
    outermost: list[int] = field(default_factory=list)
    nothing: list[F64] = field(default_factory=list)
    fronts_m: list[float] = field(default_factory=list)
    misses: int = 0
    bare: int = 0
    nearest_m: float = math.inf


class _Faces:
    """Triangles, and how far one sees among them."""

    def __init__(self, corners: F64) -> None:
        """Take the corners ``[n, 3, 3]``."""
        self._corners = corners
        self._edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        self._normals = np.cross(*self._edges)
        points = corners.reshape(-1, 3)
        self._size, self._middle = np.ptp(points, axis=0), points.mean(axis=0)
        self._rough = [np.ascontiguousarray((corners[:, k] - self._middle).T, np.float32) for k in range(3)]

    def rooms_m(self, places: Sequence[F64]) -> list[float]:
        """Return for each place the distance of the nearest face around it; 0 where it is in no room.

        Rays go from all places in the same directions. Along each, the faces are boxes in the plane across it, and few
        of them hold a place.
        """
        seen = self._seen_from(places, (1 - ENCLOSED) * _RAYS)
        return [self._room_m(place, sight) for place, sight in zip(places, seen, strict=True)]

    def opening(self, place: F64) -> tuple[F64, float] | None:
        """Return to which side a room is open around a place, level, and how far its nearest face is; else None."""
        (sight,) = self._seen_from([place], math.inf)
        if sight.misses > len(sight.nothing) + (1 - ENCLOSED) * _RAYS or sight.misses > (1 - OPEN) * _RAYS:
            return None
        if sight.misses <= (1 - ENCLOSED) * _RAYS or not self._is_room(place, sight):
            return None
        mean = np.mean(sight.nothing, axis=0)
        if np.linalg.norm(mean) < ONE_SIDE or abs(mean[1]) > _LEVEL * np.linalg.norm(mean):
            return None
        side = np.array([mean[0], 0.0, mean[2]]) / np.hypot(mean[0], mean[2])
        # Few rays tell it; most rooms stand square.
        if np.abs(side).max() > _NEARLY:
            side = np.round(side)
        return side, sight.nearest_m

    def _seen_from(self, places: Sequence[F64], most_misses: float) -> list[_Seen]:
        """Return what is seen from places, unless more rays than that have missed."""
        seen = [_Seen() for _ in places]
        slack = np.float32(_SLACK * np.linalg.norm(self._size))
        for ray in _directions(_RAYS):
            across = np.linalg.svd(ray[None])[2][1:]
            a, b, c = (across.astype(np.float32) @ each for each in self._rough)
            low, high = np.minimum(np.minimum(a, b), c) - slack, np.maximum(np.maximum(a, b), c) + slack
            for place, sight in zip(places, seen, strict=True):
                if sight.misses <= most_misses:
                    right, up = (across @ (place - self._middle)).astype(np.float32)
                    beside = np.flatnonzero((low[0] <= right) & (high[0] >= right))
                    tried = beside[(low[1, beside] <= up) & (high[1, beside] >= up)]
                    self._look(place, ray, tried, sight)
        return seen

    def _look(self, place: F64, ray: F64, tried: I64, sight: _Seen) -> None:
        """Add what a ray sees of the faces that are tried (Möller and Trumbore, JGT 1997)."""
        away = self._corners[tried, 0] - place
        facing = self._normals[tried] @ ray
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            u = -(np.cross(away, self._edges[1][tried]) @ ray) / facing
            v = -(np.cross(self._edges[0][tried], away) @ ray) / facing
            t = np.einsum("ij,ij->i", self._normals[tried], away) / facing
            hits = np.flatnonzero((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0))
        sight.misses += 1
        if not len(hits):
            sight.nothing.append(ray)
        else:
            first, last = hits[np.argmin(t[hits])], hits[np.argmax(t[hits])]
            sight.nearest_m = min(sight.nearest_m, float(t[first]))
            if facing[first] < 0:
                sight.misses -= 1
                sight.fronts.append(int(tried[first]))
                sight.outermost.append(int(tried[last]))
                sight.fronts_m.append(float(t[first]))
                sight.bare += bool(facing[last] < 0)

    def _room_m(self, place: F64, sight: _Seen) -> float:
        if sight.misses > (1 - ENCLOSED) * _RAYS:
            return 0.0
        return sight.nearest_m if self._is_room(place, sight) else 0.0

    def _is_room(self, place: F64, sight: _Seen) -> bool:
        """Return whether what is around a place is a shell of single walls, or a room of thick ones."""
        if sight.bare >= BARE * _RAYS:
            return True
        fronts, away = np.array(sight.fronts), self._corners[:, 0] - place
        if self._planes(fronts, away) < self._planes(np.array(sight.outermost), away):
            return False
        return self._is_flat_and_spacious(fronts, np.array(sight.fronts_m), away)

    def _planes(self, seen: I64, away: F64) -> int:
        """Return in how many planes faces lie."""
        same, _ = self._alike(seen, away)
        left, count = np.ones(len(seen), np.bool_), 0
        while left.any():
            left &= ~same[np.argmax(left)]
            count += 1
        return count

    def _alike(self, seen: I64, away: F64) -> tuple[npt.NDArray[np.bool_], F64]:
        """Return which of some faces lie in the same plane, and the cosines between their normals."""
        normals = self._normals[seen] / np.linalg.norm(self._normals[seen], axis=1, keepdims=True)
        apart = np.einsum("ij,ij->i", normals, away[seen])
        near = np.abs(apart[:, None] - apart) < _SAME_PLANE * float(np.linalg.norm(self._size))
        cosines: F64 = normals @ normals.T
        return near & (cosines > _PARALLEL), cosines

    def _is_flat_and_spacious(self, seen: I64, seen_m: F64, away: F64) -> bool:
        """Return whether what is seen is mostly a box's six planes, and fills much of the box around everything."""
        space = 4 / 3 * math.pi * float((seen_m**3).sum()) / _RAYS
        same, cosines = self._alike(seen, away)
        square = (np.abs(cosines) > _PARALLEL) | (np.abs(cosines) < _SQUARE)
        left, fits = np.ones((2, len(seen)), np.bool_)
        for _ in range(6):
            largest = np.argmax((same & left).sum(axis=1) * fits)
            left &= ~same[largest]
            fits &= square[largest]
        return bool(space >= SPACIOUS * self._size.prod() and (~left).sum() >= FLAT * _RAYS)


def _directions(count: int) -> F64:
    """Return directions spread evenly over the sphere (Fibonacci's spiral)."""
    k = np.arange(count) + 0.5
    y, phi = 1 - 2 * k / count, k * math.pi * (3.0 - math.sqrt(5.0))
    radius = np.sqrt(1 - y * y)
    return np.stack([radius * np.cos(phi), y, radius * np.sin(phi)], axis=1)


def _looking_in(middle: F64, size: F64, side: F64, period_s: float) -> Camera:
    """Return a camera that looks at a box from one side, and sways to the right and to the left."""
    (width, height), fov_deg = RESOLUTION, 45.0
    right_limit = math.tan(math.radians(fov_deg / 2))
    across, deep = float(np.abs(np.array([-side[2], 0.0, side[0]])) @ size) / 2, float(np.abs(side) @ size) / 2
    distance = deep + 1.05 * max(across / right_limit, float(size[1]) / 2 / (right_limit * height / width))
    shares = np.linspace(0.0, 1.0, 25)
    angles = np.radians(_SWING_DEG) * np.sin(2 * math.pi * shares) + math.atan2(side[0], side[2])
    ways = distance * np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)
    positions: list[Vec3] = [(float(x), float(y), float(z)) for x, y, z in middle + ways]
    target: Vec3 = (float(middle[0]), float(middle[1]), float(middle[2]))
    motion = LookAtKeyframes(tuple((period_s * shares).tolist()), tuple(positions), (target,) * len(positions))
    return Camera(width, height, fov_deg, motion)


def _turning(place: F64, radius_m: float, period_s: float) -> Camera:
    """Return a camera that looks out of a small circle as it goes round."""
    angles = np.linspace(0.0, 360.0, 25)
    turns: list[Quaternion] = [euler_quaternion((0.0, float(angle), 0.0)) for angle in angles]
    ways = radius_m * np.stack([-np.sin(np.radians(angles)), 0 * angles, -np.cos(np.radians(angles))], axis=1)
    positions: list[Vec3] = [(float(x), float(y), float(z)) for x, y, z in place + ways]
    times_s = tuple((period_s * angles / 360.0).tolist())
    return Camera(*RESOLUTION, 75.0, Keyframes(times_s, tuple(positions), tuple(turns)))
