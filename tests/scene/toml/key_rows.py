"""A row for each key of a scene's TOML: another value of it, and the scene in which that tells."""

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from clsim.scene.toml import schema, schema_light
from clsim.scene.toml.schema_base import Table


@dataclass
class Row:
    """What a key is changed to.

    Attributes:
        to: its other value.
        beside: other keys that are there before and after.
        also: other keys that are there after.
        instead_of: keys that are not there after.
        named: it is a name, which nothing that renders needs.
    """

    to: Any
    beside: dict[str, Any] = field(default_factory=dict)
    also: dict[str, Any] = field(default_factory=dict)
    instead_of: tuple[str, ...] = ()
    named: bool = False


def keys(*others: dict[str, Any], **first: Any) -> dict[str, Row]:
    rows = {name: row if isinstance(row, Row) else Row(row) for name, row in first.items()}
    return {name: row for each in others for name, row in each.items()} | rows


KEYFRAMES = [
    {"time_s": 0.0, "position": [0.0, 0.0, 4.0]},
    {"time_s": 0.3, "position": [1.0, 0.0, 4.0]},
    {"time_s": 0.5, "position": [1.0, 0.5, 4.0]},
    {"time_s": 1.0, "position": [0.0, 0.0, 5.0]},
]
ORBIT = {"center": [0.0, 0.0, 0.0], "radius_m": 3.0, "period_s": 2.0, "degrees": 200.0}
PICTURE = {"file": "a.png"}
FILM = {"frames": "film/*.png", "fps": 7.0}
LENS = {"aperture_radius_m": 0.05}
MOVING = {"keyframes": KEYFRAMES, "position": None}
PLACED = keys(
    position=[0.1, 0.2, 3.0],
    keyframes=Row(KEYFRAMES, instead_of=("position",)),
    orbit=Row(ORBIT, instead_of=("position",)),
    interpolation=Row("cubic", MOVING),
)
SHOWN = keys(
    PLACED,
    name=Row("other", named=True),
    material="shiny",
    rotation_deg=[10.0, 20.0, 30.0],
    scale=[1.0, 2.0, 3.0],
)
LAMP = {"radiance": [1.0, 2.0, 3.0], "radius_m": 0.3, "position": [1.0, 2.0, 0.0]}
SPOT = {"kind": "spot", "intensity": [1.0, 2.0, 3.0], "position": [1.0, 2.0, 0.0]}
SHINES = {"emission": [1.0, 2.0, 3.0]}
GLASS, DISNEY, PLASTIC = {"kind": "dielectric"}, {"kind": "disney"}, {"kind": "plastic"}
METAL, CUT = {"kind": "conductor", "roughness": 0.3}, {"alpha_mode": "mask"}
SINE = {"kind": "sine", "frequency_hz": 3.0}
PLACE_AND_TIME = {"latitude_deg": 48.0, "time": datetime(2024, 6, 21, 12), "elevation_deg": None}
ROWS: dict[type[Table], dict[str, Row]] = {
    schema.SceneTable: keys(
        fps=50.0,
        duration_s=0.4,
        base="base.obj",
        camera={"position": [0.0, 0.0, 2.0]},
        cameras=[{"name": "left"}],
        environment={"radiance": [1.0, 1.0, 1.0]},
        sensor={"threshold_on": 0.4},
        materials={"m": {"color": [0.1, 0.2, 0.3]}, "shiny": {"kind": "conductor"}},
        objects=[{"shape": "quad"}],
        sphere_lights=[LAMP],
        lights=[SPOT],
    ),
    schema.CameraTable: keys(
        PLACED,
        interpolation=Row("cubic", {"trajectory": "poses.txt", "position": None}),
        resolution=[16, 12],
        fov_deg=30.0,
        focal_length_mm=20.0,
        sensor_width_mm=Row(10.0, {"focal_length_mm": 20.0}),
        lens=LENS,
        trajectory=Row("poses.txt", instead_of=("position",)),
        trajectory_axes=Row("opengl", {"trajectory": "poses.txt", "position": None}),
        wander={"reach_m": [0.5, 0.5, 0.5]},
        shake={"sigma_m": 0.1},
        shutter_s=Row(0.01, MOVING),
        look_at=[1.0, 0.0, 0.0],
        rotation_deg=[1.0, 2.0, 3.0],
    ),
    schema.MountTable: keys(
        name="other",
        position=[0.1, 0.2, 0.3],
        rotation_deg=[1.0, 2.0, 3.0],
        resolution=[16, 12],
        fov_deg=30.0,
        lens=LENS,
        shutter_s=0.01,
    ),
    schema.LensTable: keys(
        aperture_radius_m=0.1,
        focus_distance_m=2.0,
        model="fisheye",
        distortion=[0.1],
        principal_point=[0.1, 0.2],
        view_width_m=Row(3.0, {"model": "orthographic", "view_width_m": 2.0, "aperture_radius_m": None}),
    ),
    schema.WanderTable: keys(
        seed=1, duration_s=0.5, reach_m=[0.1, 0.3, 0.1], reach_deg=[10.0, 30.0, 10.0], poses_per_s=8.0
    ),
    schema.ShakeTable: keys(seed=1, sigma_m=0.1, sigma_deg=2.0, lowest_hz=1.0, highest_hz=30.0),
    schema.EnvironmentTable: keys(
        radiance=[0.1, 0.2, 0.3],
        map="a.png",
        map_scale=Row(2.0, {"map": "a.png"}),
        map_rotation_deg=Row(30.0, {"map": "a.png"}),
        map_turn_deg_per_s=Row(30.0, {"map": "a.png"}),
        daylight={"elevation_deg": 30.0},
        modulation=Row(SINE, {"radiance": [1.0, 1.0, 1.0]}),
    ),
    schema.DaylightTable: keys(
        elevation_deg=20.0,
        azimuth_deg=100.0,
        latitude_deg=Row(40.0, PLACE_AND_TIME),
        longitude_deg=Row(40.0, PLACE_AND_TIME),
        time=Row(datetime(2024, 6, 21, 15), PLACE_AND_TIME),
        turbidity=6.0,
        ground=0.8,
        sky_scale=2.0,
        sun_scale=2.0,
    ),
    schema.SensorTable: keys(
        threshold_on=0.3, threshold_off=0.3, scale=2.0, floor=1e-2, lux_per_unit=7.0, spectral="silicon"
    ),
    schema.MaterialTable: keys(
        kind="plastic",
        color=[0.1, 0.2, 0.3],
        texture=PICTURE,
        checker={"color_a": [0.1, 0.2, 0.3], "color_b": [0.9, 0.9, 0.9]},
        emission=[1.0, 1.0, 1.0],
        emission_texture=Row(PICTURE, SHINES),
        modulation=Row(SINE, SHINES),
        emits_behind=Row(False, SHINES),
        back="black",
        roughness=Row(0.6, METAL),
        roughness_texture=Row(PICTURE, METAL),
        metallic=Row(0.6, DISNEY),
        ior=Row(1.3, GLASS),
        metal=Row("Au", METAL),
        eta=Row([0.2, 0.5, 1.2], METAL | {"eta": [0.3, 0.5, 1.2], "k": [4.0, 2.0, 2.0]}),
        k=Row([3.0, 2.0, 2.0], METAL | {"eta": [0.3, 0.5, 1.2], "k": [4.0, 2.0, 2.0]}),
        specular_color=Row([0.1, 0.2, 0.3], METAL),
        distribution=Row("beckmann", METAL),
        stretch=Row(2.0, METAL),
        absorption=Row([1.0, 2.0, 3.0], GLASS),
        nonlinear=Row(True, PLASTIC),
        specular_tint=Row(0.5, DISNEY),
        sheen=Row(0.5, DISNEY),
        sheen_tint=Row(0.5, DISNEY | {"sheen": 1.0}),
        flatness=Row(0.5, DISNEY),
        transmission=Row(0.5, DISNEY),
        clearcoat=Row(0.5, DISNEY),
        clearcoat_roughness=Row(0.5, DISNEY | {"clearcoat": 1.0}),
        normal_texture=PICTURE,
        normal_scale=Row(0.5, {"normal_texture": PICTURE}),
        bump_texture=PICTURE,
        bump_scale=Row(0.5, {"bump_texture": PICTURE}),
        alpha_mode="mask",
        alpha_cutoff=Row(0.2, CUT),
        opacity=Row(0.2, CUT),
        opacity_texture=Row(PICTURE, CUT),
    ),
    schema.ImageTable: keys(
        file="b.png",
        frames=Row("film/*.png", also={"fps": 7.0}, instead_of=("file",)),
        fps=Row(5.0, FILM | {"file": None}),
        loop=Row(False, FILM | {"file": None}),
        wrap="mirror",
        nearest=True,
        repeats=[2.0, 3.0],
    ),
    schema.CheckerTable: keys(color_a=[0.1, 0.2, 0.3], color_b=[0.1, 0.2, 0.3], squares_per_m=3.0),
    schema.BoxTable: keys(SHOWN, shape="quad", size=[1.0, 2.0, 3.0]),
    schema.QuadTable: keys(SHOWN, shape="sphere", size=[1.0, 2.0]),
    schema.SphereTable: keys(SHOWN, shape=Row("box", also={"segments": None}), radius_m=1.0, segments=7),
    schema.FileTable: keys(SHOWN, file="quad.ply"),
    schema.SphereLightTable: keys(
        PLACED, name=Row("other", named=True), radius_m=0.1, radiance=[3.0, 2.0, 1.0], modulation=SINE
    ),
    schema.LightTable: keys(
        PLACED,
        name=Row("other", named=True),
        kind="point",
        intensity=[3.0, 2.0, 1.0],
        look_at=[1.0, 0.0, 1.0],
        rotation_deg=[1.0, 2.0, 3.0],
        inner_deg=10.0,
        outer_deg=20.0,
        picture=PICTURE,
        modulation=SINE,
    ),
    schema_light.SineTable: keys(kind="pwm", frequency_hz=5.0, depth=0.5, phase_deg=20.0),
    schema_light.PwmTable: keys(kind="sine", frequency_hz=5.0, duty=0.1, low=0.3, phase_deg=200.0),
    schema_light.LightKeyframesTable: keys(
        kind=Row("sine", also={"frequency_hz": 3.0}, instead_of=("keyframes",)),
        keyframes=[{"time_s": 0.0, "factor": 0.7}],
        interpolation="step",
        repeat=True,
    ),
    schema_light.FactorTable: keys(time_s=0.4, factor=[0.3, 0.2, 0.1]),
    schema.KeyframeTable: keys(
        time_s=0.2,
        position=[1.0, 1.0, 1.0],
        rotation_deg=[1.0, 2.0, 3.0],
        quaternion=[0.0, 0.6, 0.0, 0.8],
        look_at=[1.0, 0.0, 1.0],
    ),
    schema.OrbitTable: keys(
        center=[0.0, 0.0, 1.0],
        radius_m=2.0,
        period_s=3.0,
        height_m=1.0,
        start_deg=20.0,
        degrees=30.0,
        clockwise=True,
        look_at=[0.0, 1.0, 0.0],
    ),
}


def scene_with(**tables: Any) -> dict[str, Any]:
    base = {
        "camera": CAMERA,
        "environment": {"radiance": [0.2, 0.2, 0.2]},
        "materials": {"m": {}, "shiny": {"kind": "conductor"}},
        "objects": [{"shape": "box", "material": "m"}],
    }
    return base | tables


def camera_with(**tables: Any) -> dict[str, Any]:
    return scene_with(camera=CAMERA | tables)


def lamp_with(modulation: dict[str, Any]) -> dict[str, Any]:
    return scene_with(sphere_lights=[LAMP | {"modulation": modulation}])


def material_with(**tables: Any) -> dict[str, Any]:
    return scene_with(materials={"m": tables, "shiny": {}})


CAMERA = {"position": [0.0, 0.0, 4.0], "resolution": [32, 24]}
BOX = {"shape": "box"}
Place = tuple[dict[str, Any], Callable[[dict[str, Any]], dict[str, Any]]]
PLACES: dict[type[Table], Place] = {
    schema.SceneTable: ({}, lambda table: scene_with(**table)),
    schema.CameraTable: (CAMERA, lambda table: scene_with(camera=table)),
    schema.MountTable: (
        {"name": "left"},
        lambda table: camera_with(**MOVING) | {"cameras": [table, {"name": "right"}]},
    ),
    schema.LensTable: (LENS, lambda table: camera_with(lens=table)),
    schema.WanderTable: ({}, lambda table: camera_with(wander=table)),
    schema.ShakeTable: ({}, lambda table: camera_with(shake=table)),
    schema.EnvironmentTable: ({}, lambda table: scene_with(environment=table)),
    schema.DaylightTable: ({"elevation_deg": 30.0}, lambda table: scene_with(environment={"daylight": table})),
    schema.SensorTable: ({}, lambda table: scene_with(sensor=table)),
    schema.MaterialTable: ({}, lambda table: material_with(**table)),
    schema.ImageTable: (PICTURE, lambda table: material_with(texture=table)),
    schema.CheckerTable: (
        {"color_a": [1.0, 1.0, 1.0], "color_b": [0.0, 0.0, 0.0]},
        lambda table: material_with(checker=table),
    ),
    schema.BoxTable: (BOX, lambda table: scene_with(objects=[table])),
    schema.QuadTable: ({"shape": "quad"}, lambda table: scene_with(objects=[table])),
    schema.SphereTable: ({"shape": "sphere", "segments": 5}, lambda table: scene_with(objects=[table])),
    schema.FileTable: ({"file": "base.obj"}, lambda table: scene_with(objects=[table])),
    schema.SphereLightTable: (LAMP, lambda table: scene_with(sphere_lights=[table])),
    schema.LightTable: (SPOT, lambda table: scene_with(lights=[table])),
    schema_light.SineTable: (SINE, lamp_with),
    schema_light.PwmTable: ({"kind": "pwm", "frequency_hz": 3.0}, lamp_with),
    schema_light.LightKeyframesTable: (
        {"kind": "keyframes", "keyframes": [{"time_s": 0.1, "factor": 0.5}, {"time_s": 0.4, "factor": 0.2}]},
        lamp_with,
    ),
    schema_light.FactorTable: (
        {"time_s": 0.2, "factor": 0.5},
        lambda table: lamp_with({"kind": "keyframes", "keyframes": [table, {"time_s": 0.6, "factor": 1.0}]}),
    ),
    schema.KeyframeTable: (
        {"time_s": 0.1, "position": [0.0, 0.0, 0.0]},
        lambda table: scene_with(
            objects=[BOX | {"keyframes": [table, table | {"time_s": 0.6, "position": [2.0, 2.0, 2.0]}]}]
        ),
    ),
    schema.OrbitTable: (ORBIT, lambda table: scene_with(objects=[BOX | {"orbit": table}])),
}
"""The keys that each table has before, and the scene around it."""
NOWHERE = {(schema.SceneTable, "description"): "for people; `clsim scenes` prints those of bundled ones (test_load.py)"}
