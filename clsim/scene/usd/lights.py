"""Lamps of USD (UsdLux): intensity is radiance, as renderers take it; sizes are in the file's unit."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import UsdGeom, UsdLux

from clsim.errors import InputError
from clsim.scene.modulation import Modulation
from clsim.scene.motion import Attached, Matrix, Motion, compose
from clsim.scene.pictures.images import PixelBudget, decode_rgba, decode_srgb, read_linear
from clsim.scene.rigid import without_stretch
from clsim.scene.usd.light_tracks import Source, brightest
from clsim.scene.usd.stage import PrimError, Stage
from clsim.scene.world import EnvironmentMap, Material, Mesh, PunctualLight, SphereLight, Vec3

Place = Callable[[Any], Motion]
"""From a prim to how it moves, without its scale."""
FAR = 1e4
"""Distance of what shines from afar under an angle, in sizes of the scene."""
SEGMENTS = 64


@dataclass
class Lights:
    """What of a file shines by itself.

    Attributes:
        spheres, points: lamps.
        suns: disks in the sky: radiance, direction's motion (they shine along −z), half the angle [rad], name, change.
        surfaces: lamps with a shape: their mesh in the prim's space, material and prim.
        sky: radiance of the whole sky, without a picture.
        sky_map: its picture.
        sky_change: how the sky's light changes.
    """

    spheres: list[SphereLight] = field(default_factory=list)
    points: list[PunctualLight] = field(default_factory=list)
    suns: list[tuple[Vec3, Motion, float, str, Modulation | None]] = field(default_factory=list)
    surfaces: list[tuple[Mesh, Material, Any]] = field(default_factory=list)
    sky: Vec3 = (0.0, 0.0, 0.0)
    sky_map: EnvironmentMap | None = None
    sky_change: Modulation | None = None


class LightReader:
    """Reads lamps one by one.

    Attributes:
        lights: what was read so far.
    """

    def __init__(self, stage: Stage, place: Place, warn: Callable[[str], None], *, repeat: bool) -> None:
        """Read from a stage; ``place`` tells how prims move, ``warn`` takes what is left out."""
        self.lights = Lights()
        self._stage, self._place, self._warn, self._repeat = stage, place, warn, repeat
        self._budget = PixelBudget()

    def read(self, prim: Any) -> bool:
        """Add a prim's light; tells whether it is a lamp."""
        kind = str(prim.GetTypeName())
        if kind in ("DomeLight", "DomeLight_1"):
            self._dome(prim)
        elif kind == "DistantLight":
            self._distant(prim)
        elif kind == "SphereLight":
            self._sphere(prim)
        elif kind in ("RectLight", "DiskLight", "CylinderLight"):
            self._surface(prim, kind)
        elif prim.HasAPI(UsdLux.LightAPI):
            self._warn(f"lamps of type {kind} are left out (first {prim.GetName()})")
            return not prim.IsA(UsdGeom.Gprim)  # a mesh that shines is still a mesh
        else:
            return False
        self._tell_chosen(prim)
        return True

    def _tell_chosen(self, prim: Any) -> None:
        """Warn of light that would reach only some things, or some parts of what surfaces scatter."""
        name, get = prim.GetName(), prim.GetAttribute
        if any(self._stage.value(get(f"inputs:{part}")) not in (None, 1.0) for part in ("diffuse", "specular")):
            self._warn(f"factors of lamps on diffuse and specular light are left out (first {name})")
        if self._stage.value(get("inputs:shadow:enable")) is False:
            self._warn(f"lamps without shadows have shadows (first {name})")
        places = [
            f"collection:{link}Link:{which}" for link in ("light", "shadow") for which in ("includes", "excludes")
        ]
        if any(link.GetTargets() for place in places if (link := prim.GetRelationship(place))):
            self._warn(f"lamps for some objects shine on all (first {name})")

    def _input(self, prim: Any, name: str) -> Any:
        """Return what tells an input of a lamp; files of before USD 21.02 have no ``inputs:`` before its name."""
        now, before = prim.GetAttribute(f"inputs:{name}"), prim.GetAttribute(name)
        old = before and before.HasAuthoredValue() and not (now and now.HasAuthoredValue())
        return before if old else now

    def _size(self, prim: Any, name: str, default: float) -> float:
        found = self._stage.still(self._input(prim, name))
        size = default if found is None else abs(float(found))
        if not math.isfinite(size):
            raise PrimError(f"{self._stage.path}: {prim.GetPath()} has a {name} that is not finite")
        return size

    def _radiance(self, prim: Any, area: float) -> tuple[Vec3, Modulation | None]:
        """Return intensity, exposure, colour and temperature as one, over an area where the lamp says so."""
        area = area if self._stage.value(self._input(prim, "normalize")) and area > 0 else 1.0
        sources: list[Source] = [
            (self._input(prim, "intensity"), lambda value: (1.0 if value is None else float(value)) / area),
            (self._input(prim, "exposure"), lambda value: 2.0 ** min(float(value or 0.0), 120.0)),
            (self._input(prim, "color"), lambda value: (1.0, 1.0, 1.0) if value is None else tuple(value)),
        ]
        if self._stage.value(self._input(prim, "enableColorTemperature")):
            kelvin = self._input(prim, "colorTemperature")
            sources.append((kelvin, lambda value: _black_body(6500.0 if value is None else float(value))))
        return brightest(self._stage, sources, repeat=self._repeat)

    def _sphere(self, prim: Any) -> None:
        radius = self._size(prim, "radius", 0.5)
        scale = float(np.cbrt(abs(np.linalg.det(self._stage.to_world(prim, self._stage.start)[:3, :3]))))
        unit = scale / self._stage.metres
        radiance, change = self._radiance(prim, 4 * math.pi * (radius * unit) ** 2)
        motion, name = self._place(prim), prim.GetName()
        outer = self._size(prim, "shaping:cone:angle", 90.0)
        self._left_out(prim, name, "shaping:focus", "shaping:ies:file")
        as_point = bool(self._stage.value(prim.GetAttribute("treatAsPoint"))) or radius == 0
        if outer >= 90.0 and not as_point:
            self.lights.spheres.append(SphereLight(radius * scale, radiance, motion, name, change))
            return
        # A small sphere's intensity is its radiance times π·r²; without a size that of 1/(4·r²) of its surface.
        normalised = bool(self._stage.value(self._input(prim, "normalize")))
        squared = 1.0 / (4 * math.pi) if radius == 0 else (radius * unit) ** 2
        to_metres = self._stage.metres**2 if normalised or radius > 0 else 1.0
        r, g, b = (channel * math.pi * squared * to_metres for channel in radiance)
        if outer >= 90.0:
            self.lights.points.append(PunctualLight("point", (r, g, b), motion, name=name, modulation=change))
            return
        softness = min(self._size(prim, "shaping:cone:softness", 0.0), 1.0)
        spot = PunctualLight("spot", (r, g, b), motion, outer * (1 - softness), outer, "smooth", name, change)
        self.lights.points.append(spot)
        if not as_point:
            self._warn(f"spheres that shine into a cone are spots without size (first {name})")

    def _distant(self, prim: Any) -> None:
        angle = math.radians(min(self._size(prim, "angle", 0.53), 90.0))
        size = math.pi * math.sin(angle / 2) ** 2
        radiance, change = self._radiance(prim, size)
        motion, name = self._place(prim), prim.GetName()
        if angle > 0:
            self.lights.suns.append((radiance, motion, angle / 2, name, change))
        else:
            self.lights.points.append(PunctualLight("directional", radiance, motion, name=name, modulation=change))

    def _surface(self, prim: Any, kind: str) -> None:
        linear = self._stage.to_world(prim, self._stage.start)[:3, :3]
        if kind == "RectLight":
            mesh = _rectangle(self._size(prim, "width", 1.0), self._size(prim, "height", 1.0))
        elif kind == "DiskLight":
            mesh = _disk(self._size(prim, "radius", 0.5))
        else:
            mesh = _cylinder(self._size(prim, "radius", 0.5), self._size(prim, "length", 1.0))
        corners = (mesh.vertices.astype(np.float64) @ linear.T / self._stage.metres)[mesh.triangles]
        sides = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = float(np.linalg.norm(np.cross(*sides), axis=1).sum()) / 2
        radiance, change = self._radiance(prim, area)
        name = prim.GetName()
        if area == 0:
            self._warn(f"lamps that have no area send out no light (first {name})")
        self._left_out(prim, name, "shaping:cone:angle", "shaping:focus", "shaping:ies:file", "texture:file")
        material = Material(color=(0.0, 0.0, 0.0), emission=radiance, modulation=change, emits_behind=False, name=name)
        self.lights.surfaces.append((mesh, material, prim))

    def _left_out(self, prim: Any, name: str, *inputs: str) -> None:
        for key in inputs:
            attribute = self._input(prim, key)
            value = self._stage.value(attribute) if attribute and attribute.HasAuthoredValue() else None
            if value and not (key.endswith("angle") and value >= 90.0):
                self._warn(f"{key} of lamps is left out (first {name})")

    def _dome(self, prim: Any) -> None:
        radiance, change = self._radiance(prim, 1.0)
        if self.lights.sky_map is not None or any(self.lights.sky):
            self._warn(f"of several domes the first is used ({prim.GetName()} is left out)")
            return
        self.lights.sky_change = change
        try:
            picture = self._dome_picture(prim)
        except InputError as error:
            self._warn(f"the dome's texture is left out: {error}")
            picture = None
        if picture is None:
            self.lights.sky = radiance
            return
        turn = without_stretch(self._stage.to_world(prim, self._stage.start))
        if prim.GetTypeName() == "DomeLight_1" and self._pole(prim) == "Z":
            turn = turn @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        self.lights.sky_map = EnvironmentMap((picture * np.array(radiance)).astype(np.float32), turn)
        if self._place(prim).duration_s:
            self._warn(f"the dome {prim.GetName()} does not turn")

    def _dome_picture(self, prim: Any) -> Any:
        file = self._input(prim, "texture:file")
        named = self._stage.picture(file) if file else None
        if named is None:
            return None
        layout = str(self._stage.value(self._input(prim, "texture:format")) or "automatic")
        if layout not in ("automatic", "latlong"):
            raise InputError(f"its format is {layout}, expected latlong")
        name, found = named
        if isinstance(found, bytes):
            if name.lower().endswith((".exr", ".hdr")):
                raise InputError(f"{name} is packed, expected a file of its own, or PNG or JPEG")
            return decode_srgb(decode_rgba(name, found, self._budget)[..., :3] / 255.0)
        return read_linear(found, self._budget)

    def _pole(self, prim: Any) -> str:
        pole = str(self._stage.value(prim.GetAttribute("poleAxis")) or "scene")
        return ("Z" if self._stage.z_up else "Y") if pole == "scene" else pole


def suns(lights: Lights, middle_m: Vec3, radius_m: float) -> list[SphereLight]:
    """Return lamps that shine from afar under an angle as spheres far from the middle of what they light."""
    away_m = FAR * max(radius_m, 1e-6)
    offset = compose((0.0, 0.0, away_m), np.eye(3))
    return [
        SphereLight(away_m * math.sin(half), radiance, Attached(_Turning(motion, middle_m), offset), name, change)
        for radiance, motion, half, name, change in lights.suns
    ]


@dataclass(frozen=True)
class _Turning:
    """The rotation of a motion, about a point."""

    motion: Motion
    middle_m: Vec3

    @property
    def duration_s(self) -> float:
        return self.motion.duration_s

    def pose(self, time_s: float) -> Matrix:
        return compose(self.middle_m, self.motion.pose(time_s)[:3, :3])


def _black_body(kelvin: float) -> Vec3:
    """Return the colour of a temperature; usd-core ends the process where it is no number."""
    if not math.isfinite(kelvin):
        raise ValueError(f"a colour temperature of {kelvin} K")
    r, g, b = UsdLux.BlackbodyTemperatureAsRgb(kelvin)
    return r, g, b


def _rectangle(width: float, height: float) -> Mesh:
    """Return a rectangle in the xy plane that faces −z."""
    x, y = width / 2, height / 2
    return _mesh([(-x, -y, 0), (-x, y, 0), (x, y, 0), (x, -y, 0)], [(0, 1, 2), (0, 2, 3)])


def _disk(radius: float) -> Mesh:
    """Return a disk in the xy plane that faces −z, of the true one's area."""
    angles = np.linspace(0.0, 2 * math.pi, SEGMENTS, endpoint=False)
    step = 2 * math.pi / SEGMENTS
    rim = radius * math.sqrt(step / math.sin(step))
    vertices = [(0.0, 0.0, 0.0), *zip(rim * np.cos(angles), rim * np.sin(angles), np.zeros(SEGMENTS), strict=True)]
    return _mesh(vertices, [(0, 1 + (k + 1) % SEGMENTS, 1 + k) for k in range(SEGMENTS)])


def _cylinder(radius: float, length: float) -> Mesh:
    """Return the side of a cylinder about x that faces outwards, of the true one's area."""
    angles = np.linspace(0.0, 2 * math.pi, SEGMENTS, endpoint=False)
    rim = radius * (math.pi / SEGMENTS) / math.sin(math.pi / SEGMENTS)
    ring = np.stack([rim * np.cos(angles), rim * np.sin(angles)], axis=1)
    vertices = [(x, *point) for x in (-length / 2, length / 2) for point in ring.tolist()]
    triangles = []
    for k in range(SEGMENTS):
        a, b = k, (k + 1) % SEGMENTS
        triangles += [(a, b, b + SEGMENTS), (a, b + SEGMENTS, a + SEGMENTS)]
    return _mesh(vertices, triangles)


def _mesh(vertices: Any, triangles: Any) -> Mesh:
    faces = np.ascontiguousarray(triangles, np.int32)
    return Mesh(np.ascontiguousarray(vertices, np.float32), faces, np.zeros(len(faces), np.int32))
