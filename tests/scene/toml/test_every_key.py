"""Each key of a scene's TOML changes the world, and the world changes what renders it and what finds events in it."""

import json
from datetime import datetime
from functools import cache, partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import trimesh
from PIL import Image

from clsim.live.options import LiveOptions
from clsim.live.pacing.schedule import plan
from clsim.live.rig import cameras_of
from clsim.live.stages import plan_stages
from clsim.render import RenderOptions, SceneData
from clsim.render.camera.camera import CameraData
from clsim.render.kernel_input import settings_of
from clsim.scene import World, load_world
from clsim.scene.light import daylight
from clsim.scene.toml import schema
from clsim.scene.toml.schema_base import Table
from clsim.sensor import SensorSettings
from clsim.sensor.pixel_stages import FrontEnd
from tests.contents import contents
from tests.scene.toml.key_rows import NOWHERE, PLACES, ROWS

TIMES_S = (0.013, 0.21, 0.71)
"""Not all of them a whole number of anything."""


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(each)}" for key, each in value.items() if each is not None) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return value.isoformat() if isinstance(value, datetime) else json.dumps(value)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files that scenes name."""
    path = tmp_path_factory.mktemp("keys")
    (path / "film").mkdir()
    random = np.random.default_rng(0)
    for name in ("a.png", "b.png", "film/1.png", "film/2.png", "film/3.png"):
        Image.fromarray(random.integers(0, 256, (4, 8, 4), np.uint8)).save(path / name)
    trimesh.creation.box((1.0, 2.0, 3.0)).export(path / "base.obj")
    trimesh.creation.icosphere(0).export(path / "quad.ply")
    (path / "poses.txt").write_text("0 0 0 4 0 0 0 1\n0.5 1 0 4 0 0.6 0 0.8\n1 0 1 5 0 0 0 1\n")
    return path


@pytest.fixture(autouse=True)
def coarse_sky(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the sky be a small picture: it takes most of the time."""
    monkeypatch.setattr(daylight, "sky", partial(daylight.sky, rows=16))


def load(folder: Path, scene: dict[str, Any]) -> World:
    path = folder / "scene.toml"
    path.write_text("".join(f"{key} = {toml(value)}\n" for key, value in scene.items() if value is not None))
    return load_world(path)


@cache
def light_meter() -> SensorSettings:
    """Return a sensor to which it matters how bright the scene is."""
    return SensorSettings(name="slow", front_end=FrontEnd(receptor_hz_per_lux=1.0))


def reached(world: World) -> Any:
    """Return all that the world tells whoever renders it, and whoever finds events in it."""
    cameras = cameras_of(world) or {"camera": world.camera}
    data = SceneData(world, interval_s=max(camera.shutter_s for camera in cameras.values()))
    found = [contents(data.features)]
    for time_s in TIMES_S:
        data.move(time_s)
        found.append((contents(data.shine(time_s, time_s)), contents(data.scene)))
    for name, camera in cameras.items():
        features = RenderOptions().features(data.features, camera)
        views = CameraData(camera, features, data.origin_m, data.device)
        found.append((name, contents(features), [contents(views.at(time_s)) for time_s in TIMES_S]))
        found.append(contents(settings_of(RenderOptions(), camera, world.sensor)))
    stages = plan_stages(LiveOptions("scene", sensor=light_meter(), time="fixed"), world)
    found.append(contents((stages.detector, stages.make_detector, plan(world.duration_s, stages.fps))))
    return repr(found)


def tables(table: Any = schema.SceneTable) -> set[type[Table]]:
    """Return all tables within one, and itself."""
    if isinstance(table, type) and issubclass(table, Table):
        inner = [field.annotation for field in table.model_fields.values()]
        return {table}.union(*map(tables, inner))
    return set().union(*map(tables, get_args(table)))


def test_each_key_of_each_table_has_a_row() -> None:
    assert {*ROWS} == {*PLACES} == tables()
    named = {(table, key) for table, rows in ROWS.items() for key in rows}
    assert named | {*NOWHERE} == {(table, key) for table in tables() for key in table.model_fields}
    assert not named & {*NOWHERE}


@pytest.mark.parametrize("table", ROWS, ids=lambda table: table.__name__)
def test_a_key_changes_the_world_and_what_is_made_of_it(table: type[Table], folder: Path) -> None:
    needed, around = PLACES[table]
    plain: dict[str, tuple[Any, str]] = {}
    worlds = {}
    for key, row in ROWS[table].items():
        before = needed | row.beside
        after = {name: value for name, value in before.items() if name not in row.instead_of} | row.also | {key: row.to}
        told = toml(before)
        if told not in plain:
            plain[told] = contents(load(folder, around(before))), reached(load(folder, around(before)))
        changed = load(folder, around(after))
        assert contents(changed) != plain[told][0], f"{key} changes nothing"
        assert row.named or reached(changed) != plain[told][1], f"{key} changes nothing that is rendered or detected"
        worlds[key] = contents(changed)
    assert len({*worlds.values()}) == len(worlds), "two keys do the same"


def test_a_world_is_like_itself(folder: Path) -> None:
    """What changes from one load to the next would pass for a key's doing."""
    for needed, around in PLACES.values():
        first, second = (load(folder, around(needed)) for _ in range(2))
        assert contents(first) == contents(second) and reached(first) == reached(second)
