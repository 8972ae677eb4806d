"""What a scene's TOML may say. ``key_table()`` prints every key; lengths in m, times in s, angles in degrees.

Unknown keys, wrong types, NaN and infinities are errors; all of a file's errors are told at once, one line each.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, Discriminator, Field, Strict, Tag

from clsim.scene.light.spectra import METALS
from clsim.scene.toml.schema_base import (
    Flag,
    NonNegative,
    NonNegatives,
    Number,
    Pixels,
    Positive,
    Quaternion4,
    Radiance,
    Reflectance,
    Share,
    Size2,
    Size3,
    Table,
    Vector,
)
from clsim.scene.toml.schema_light import (
    DaylightTable,
    FactorTable,
    LightKeyframesTable,
    Modulation,
    PwmTable,
    SineTable,
    Spectral,
)


class KeyframeTable(Table):
    """A pose at a time; keyframes are joined linearly, rotations by slerp."""

    time_s: NonNegative
    position: Vector
    rotation_deg: Vector | None = Field(None, description="turns about the fixed x, then y, then z axis")
    quaternion: Quaternion4 | None = Field(None, description="x, y, z, w; instead of rotation_deg")
    look_at: Vector | None = Field(None, description="point that −z looks at; instead of a rotation")


class OrbitTable(Table):
    """A circle about the vertical, counter-clockwise seen from above."""

    center: Vector
    radius_m: Positive
    period_s: Positive = Field(description="time of a full turn")
    height_m: Number = 0.0
    start_deg: Number = Field(0.0, description="angle at time 0, from +z towards +x")
    degrees: Positive | None = Field(None, description="how far to go; without it, on and on")
    clockwise: Flag = False
    look_at: Vector | None = Field(None, description="point that −z looks at; a camera's default is the centre")


class Placed(Table):
    """What has a place: still, keyframed or orbiting."""

    position: Vector | None = Field(None, description="[0, 0, 0] where neither keyframes nor orbit is given")
    keyframes: Annotated[tuple[KeyframeTable, ...], Field(min_length=1)] | None = None
    orbit: OrbitTable | None = None
    interpolation: Literal["linear", "cubic"] = Field("linear", description="how keyframes and trajectories are joined")


class LensTable(Table):
    """What makes a camera more than a pinhole; coefficients as OpenCV defines them."""

    aperture_radius_m: NonNegative = Field(default=0.0, description="of a thin lens; 0 is a pinhole")
    focus_distance_m: Positive = 1.0
    model: Literal["perspective", "fisheye", "orthographic"] = "perspective"
    distortion: Annotated[tuple[Number, ...], Field(max_length=5)] = Field(
        default=(), description="perspective: k1, k2, p1, p2, k3; fisheye: k1 to k4"
    )
    principal_point: tuple[Number, Number] = Field(
        default=(0.0, 0.0), description="offset of the optical centre, right and down, in image widths"
    )
    view_width_m: NonNegative = Field(default=0.0, description="orthographic: width of what is seen")


class WanderTable(Table):
    """A random path about the place or the motion: a smooth spline through random poses."""

    seed: Annotated[int, Strict(), Field(ge=0)] = 0
    duration_s: Positive = 10.0
    reach_m: NonNegatives = Field((0.1, 0.1, 0.1), description="farthest poses along the camera's x, y, z")
    reach_deg: NonNegatives = Field((10.0, 10.0, 10.0), description="farthest turns about them")
    poses_per_s: Annotated[float, Strict(), Field(gt=0, le=1000)] = 5.0


class ShakeTable(Table):
    """Trembling about the place or the motion: sines of random frequencies, for ever."""

    seed: Annotated[int, Strict(), Field(ge=0)] = 0
    sigma_m: NonNegative = Field(0.002, description="standard deviation along each axis")
    sigma_deg: NonNegative = Field(0.3, description="standard deviation about each axis")
    lowest_hz: Positive = 2.0
    highest_hz: Positive = 15.0


class CameraTable(Placed):
    """A camera that looks along −z."""

    position: Vector | None = Field(None, description="needed without keyframes, orbit and trajectory")
    resolution: tuple[Pixels, Pixels] = Field((346, 260), description="width, height")
    fov_deg: Annotated[float, Strict(), Field(gt=0, lt=180)] = Field(50.0, description="horizontal field of view")
    focal_length_mm: Positive | None = Field(None, description="instead of fov_deg")
    sensor_width_mm: Positive = Field(36.0, description="what the focal length belongs to")
    lens: LensTable = LensTable()
    trajectory: str | None = Field(
        None, description="a file of poses (TUM text, CSV, npz) or a glTF with a camera, instead of keyframes"
    )
    trajectory_axes: Literal["opencv", "opengl"] = Field(
        "opencv", description="opencv: +z ahead and y down, as in the benchmark; opengl: −z ahead and y up"
    )
    wander: WanderTable | None = None
    shake: ShakeTable | None = None
    shutter_s: NonNegative = Field(0.0, description="length of the exposure, 0 is an instant")
    look_at: Vector | None = Field(None, description="also the target of keyframes that name none")
    rotation_deg: Vector | None = Field(None, description="instead of look_at")


class MountTable(Table):
    """One of several cameras on a rig, which is ``[camera]``: what it does not say is as there."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] = Field(description="for the names of its outputs")
    position: Vector = Field((0.0, 0.0, 0.0), description="on the rig: to the right, up and behind")
    rotation_deg: Vector | None = Field(None, description="on the rig: turns about its x, then y, then z axis")
    resolution: tuple[Pixels, Pixels] | None = None
    fov_deg: Annotated[float, Strict(), Field(gt=0, lt=180)] | None = None
    lens: LensTable | None = None
    shutter_s: NonNegative | None = None


class SphereLightTable(Placed):
    """A glowing sphere."""

    name: str = ""
    radius_m: Positive
    radiance: Radiance
    modulation: Modulation = None


class ImageTable(Table):
    """An image as a texture; of ``texture`` and ``emission_texture`` it may be a film."""

    file: str | None = Field(
        None, description="PNG, JPEG, OpenEXR or HDR, relative to the TOML's folder; or a video such as .mp4"
    )
    frames: str | None = Field(None, description="instead, files such as screen/*.png, in the order of their numbers")
    fps: Annotated[float, Strict(), Field(gt=0, le=1e6)] | None = Field(
        None, description="pictures per second: of frames needed, a video's own is the default"
    )
    loop: Flag = Field(True, description="whether a film starts anew at its end; else its last picture stays")
    wrap: Literal["repeat", "clamp", "mirror"] = "repeat"
    nearest: Flag = Field(False, description="no smoothing between pixels")
    repeats: tuple[Number, Number] = Field(
        (1.0, 1.0), description="per unit of u and v: per metre on boxes, quads and spheres"
    )


class LightTable(Placed):
    """A light without size; it shines along −z."""

    name: str = ""
    kind: Literal["point", "spot", "directional"]
    intensity: Radiance = Field(description="W/sr; of a directional light W/m²")
    look_at: Vector | None = Field(None, description="point that it shines at")
    rotation_deg: Vector | None = Field(None, description="instead of look_at")
    inner_deg: Annotated[float, Strict(), Field(ge=0, le=90)] = Field(0.0, description="half angle of a spot's core")
    outer_deg: Annotated[float, Strict(), Field(gt=0, le=90)] = Field(45.0, description="half angle of its cone")
    picture: ImageTable | None = Field(None, description="what a spot projects, over the square around its cone")
    modulation: Modulation = None


class ObjectTable(Placed):
    """What all objects have."""

    name: str = ""
    material: str | None = Field(None, description="a name from materials; without it, grey (or the file's own)")
    rotation_deg: Vector | None = Field(None, description="turns about the fixed x, then y, then z axis")
    scale: Positive | Size3 = Field(1.0, description="one factor or one per axis, before the rotation")


class BoxTable(ObjectTable):
    """A box about its position."""

    shape: Literal["box"]
    size: Size3 = (1.0, 1.0, 1.0)


class QuadTable(ObjectTable):
    """A rectangle in the xz plane that faces +y."""

    shape: Literal["quad"]
    size: Size2 = (1.0, 1.0)


class SphereTable(ObjectTable):
    """A sphere with smooth normals."""

    shape: Literal["sphere"]
    radius_m: Positive = 0.5
    segments: Annotated[int, Strict(), Field(ge=3, le=1024)] = Field(48, description="round the equator")


class FileTable(ObjectTable):
    """A mesh file."""

    file: str = Field(description=".obj, .ply, .gltf, .glb or USD, relative to the TOML's folder")


OBJECTS: dict[str, type[ObjectTable]] = {"box": BoxTable, "quad": QuadTable, "sphere": SphereTable, "file": FileTable}


def _object_kind(value: Any) -> str | None:
    if isinstance(value, ObjectTable):
        return next(kind for kind, table in OBJECTS.items() if isinstance(value, table))
    if not isinstance(value, dict) or ("file" in value) == ("shape" in value):
        return None
    return "file" if "file" in value else str(value["shape"])


AnyObject = Annotated[
    Annotated[BoxTable, Tag("box")]
    | Annotated[QuadTable, Tag("quad")]
    | Annotated[SphereTable, Tag("sphere")]
    | Annotated[FileTable, Tag("file")],
    Discriminator(_object_kind),
]


class CheckerTable(Table):
    """Two colours in squares; they take the place of ``color``."""

    color_a: Reflectance
    color_b: Reflectance
    squares_per_m: Positive = Field(1.0, description="per unit of u and v on meshes from files")


class MaterialTable(Table):
    """A surface; colours are linear Rec. 709."""

    kind: Literal["diffuse", "conductor", "dielectric", "thin-dielectric", "plastic", "principled", "disney"] = Field(
        "diffuse", description="principled is glTF's, disney is Mitsuba's principled"
    )
    color: Reflectance | None = Field(None, description="reflectance or base colour 0…1, default 0.5; metal, glass 1")
    texture: ImageTable | None = Field(None, description="times the colour, whose default is then 1")
    checker: CheckerTable | None = None
    emission: Radiance = Field((0.0, 0.0, 0.0), description="radiance; anything above 0 makes an area light")
    emission_texture: ImageTable | None = None
    modulation: Modulation = None
    emits_behind: Flag = Field(True, description="whether the back emits as the front does")
    back: Literal["same", "black", "culled"] = Field(
        "same", description="what the back scatters: as the front, nothing, or it is not there for the camera"
    )
    roughness: Share = Field(0.0, description="perceptual: the square root of GGX's alpha; 0 is smooth")
    roughness_texture: ImageTable | None = Field(None, description="G is roughness, B metalness, as in glTF")
    metallic: Share = 0.0
    ior: Annotated[float, Strict(), Field(ge=1, le=10)] = 1.5
    metal: str | None = Field(
        None, description=f"what a conductor is made of, {', '.join(METALS)}; without, its colour counts"
    )
    eta: Radiance | None = Field(None, description="refractive index of a conductor, with k instead of metal")
    k: Radiance | None = Field(None, description="extinction coefficient of a conductor")
    specular_color: Reflectance = (1.0, 1.0, 1.0)
    distribution: Literal["ggx", "beckmann"] = Field("ggx", description="of a conductor, dielectric or plastic")
    stretch: Positive = Field(
        1.0, description="of a conductor, dielectric or disney: squared roughness times this along u, over this along v"
    )
    absorption: Radiance = Field((0.0, 0.0, 0.0), description="within a dielectric or disney glass, per metre")
    nonlinear: Flag = Field(False, description="whether inner reflections shift the colour of plastic")
    specular_tint: Share = Field(0.0, description="of disney, as are sheen, its tint and flatness")
    sheen: NonNegative = 0.0
    sheen_tint: Share = 0.0
    flatness: Share = 0.0
    transmission: Share = 0.0
    clearcoat: Share = 0.0
    clearcoat_roughness: Share = 0.0
    normal_texture: ImageTable | None = None
    normal_scale: Number = 1.0
    bump_texture: ImageTable | None = Field(None, description="its luminance is height, without sRGB's curve")
    bump_scale: Number = Field(1.0, description="metres of height for a luminance of 1")
    alpha_mode: Literal["opaque", "mask", "blend"] = "opaque"
    alpha_cutoff: Share = 0.5
    opacity: Share = 1.0
    opacity_texture: ImageTable | None = Field(None, description="its alpha channel counts")


class EnvironmentTable(Table):
    """The light from everywhere."""

    radiance: Radiance = (0.0, 0.0, 0.0)
    map: str | None = Field(default=None, description="latitude-longitude image: OpenEXR, HDR, PNG or JPEG")
    map_scale: NonNegative = 1.0
    map_rotation_deg: Number = Field(default=0.0, description="turns the map about +y")
    map_turn_deg_per_s: Number = Field(default=0.0, description="how fast it turns about +y")
    daylight: DaylightTable | None = Field(default=None, description="instead of map")
    modulation: Modulation = None


class SensorTable(Table):
    """The event pixel: L = ln max(scale·Y, floor), contrast thresholds in natural-log units."""

    threshold_on: Positive = 0.2
    threshold_off: Positive = 0.2
    scale: Positive = 1.0
    floor: Positive = 1e-4
    lux_per_unit: Positive = Field(default=100.0, description="illuminance of the sensor under a luminance of 1")
    spectral: Spectral = Field(
        default="luminance", description="what Y is: of eyes, of silicon, or weights of R, G and B, for their sum 1"
    )


class SceneTable(Table):
    """A whole scene."""

    description: str = ""
    fps: Positive = Field(120.0, description="frames per simulated second")
    duration_s: Positive | None = Field(None, description="default: until all motion has ended, 1 s without motion")
    base: str | None = Field(None, description="a scene file of another program, to which this one adds")
    camera: CameraTable | None = Field(None, description="needed where base has none to give")
    cameras: tuple[MountTable, ...] = ()
    environment: EnvironmentTable = EnvironmentTable()
    sensor: SensorTable = SensorTable()
    materials: dict[str, MaterialTable] = {}  # noqa: RUF012 - pydantic copies defaults
    objects: tuple[AnyObject, ...] = ()
    sphere_lights: tuple[SphereLightTable, ...] = ()
    lights: tuple[LightTable, ...] = ()


def key_table() -> str:
    """Return all keys with their types, defaults and meaning, as Markdown tables, one per TOML table."""
    sections: list[tuple[str, type[Table]]] = [
        ("top level", SceneTable),
        ("[camera]", CameraTable),
        ("[[cameras]]", MountTable),
        ("lens = {…}", LensTable),
        ("wander = {…}", WanderTable),
        ("shake = {…}", ShakeTable),
        ("[environment]", EnvironmentTable),
        ("[environment.daylight]", DaylightTable),
        ("[sensor]", SensorTable),
        ("[materials.NAME]", MaterialTable),
        ("texture = {…}", ImageTable),
        ("checker = {…}", CheckerTable),
        ('[[objects]] shape = "box"', BoxTable),
        ('[[objects]] shape = "quad"', QuadTable),
        ('[[objects]] shape = "sphere"', SphereTable),
        ('[[objects]] file = "…"', FileTable),
        ("[[sphere_lights]]", SphereLightTable),
        ("[[lights]]", LightTable),
        ('modulation = { kind = "sine", … }', SineTable),
        ('modulation = { kind = "pwm", … }', PwmTable),
        ('modulation = { kind = "keyframes", … }', LightKeyframesTable),
        ("keyframes = [{…}, …] in modulation", FactorTable),
        ("keyframes = [{…}, …]", KeyframeTable),
        ("orbit = {…}", OrbitTable),
    ]
    lines: list[str] = []
    for heading, table in sections:
        lines += [f"### {heading}", "", table.__doc__ or "", "", "| key | default | meaning |", "|---|---|---|"]
        for key, info in table.model_fields.items():
            if info.is_required():
                default = "needed"
            elif isinstance(info.default, BaseModel) or info.default in (None, (), {}, ""):
                default = ""
            else:
                default = str(list(info.default) if isinstance(info.default, tuple) else info.default)
            meaning = "; ".join(part for part in (_choices(info.annotation), info.description) if part)
            lines.append(f"| {key} | {default} | {meaning} |")
        lines.append("")
    return "\n".join(lines)


def _choices(annotation: Any) -> str:
    """Return the values that a key may have, where they are few."""
    if get_origin(annotation) is not Literal:
        return ""
    return "one of " + ", ".join(f"`{value}`" for value in get_args(annotation))
