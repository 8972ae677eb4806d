"""Specifications: reading, refusing, and the scenes that they make."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from clsim.datasets.scene_file import scene_text
from clsim.datasets.spec import bundled_specs, load_spec
from clsim.datasets.toml import read_toml, to_toml
from clsim.errors import InputError
from clsim.scene import load_world

_TEXT = """
count = 6
split = { train = 0.5, test = 0.5 }
[run]
threshold = { uniform = [0.15, 0.3] }
truth = ["flow", "depth"]
[scene]
base = "two-boxes"
[scene.camera]
wander = { seed = { integers = [0, 1000] } }
"""


def spec_of(tmp_path, text=_TEXT, **options):
    path = tmp_path / "a.toml"
    path.write_text(text)
    return load_spec(str(path), **options)


def test_a_sequence_has_its_options_and_its_scene(tmp_path):
    spec = spec_of(tmp_path)
    sample = spec.sample(4)
    assert 0.15 <= sample.run["threshold"] <= 0.3
    assert sample.split in ("train", "test")
    assert len({spec.sample(index).run["seed"] for index in range(5)}) == 5
    scene = tmp_path / "scene.toml"
    scene.write_text(scene_text(sample.scene))
    drawn, base = load_world(str(scene)), load_world("two-boxes")
    assert len(drawn.instances) == len(base.instances)
    assert (drawn.camera.motion.pose(0.05) != base.camera.motion.pose(0.05)).any()


def test_a_bases_camera_gives_way_to_a_place_that_is_drawn(tmp_path):
    text = scene_text({"base": "two-boxes", "camera": {"position": [0.0, 1.0, 4.0]}})
    assert "keyframes" not in text.partition("[camera]")[2].partition("[environment]")[0]
    assert "fov_deg = 50.0" in text


@pytest.mark.parametrize(
    "moves",
    ["position = [1, 2, 3]", "orbit = { radius_m = 1.0, period_s = 2.0 }", "keyframes = []", "trajectory = 'a.csv'"],
)
def test_a_base_moves_no_more_where_a_place_is_drawn(tmp_path, moves):
    (tmp_path / "base.toml").write_text(f"[camera]\nfov_deg = 40\n{moves}\n")
    scene = {"base": str(tmp_path / "base.toml"), "camera": {"position": [0.0, 1.0, 4.0]}}
    (tmp_path / "a.toml").write_text(scene_text(scene))
    assert read_toml(tmp_path / "a.toml") == {"camera": {"fov_deg": 40, "position": [0.0, 1.0, 4.0]}}


def test_a_table_that_the_base_lacks_is_added(tmp_path):
    (tmp_path / "bare.toml").write_text(
        "fps = 60\nmaterials.wall.color_texture = 'a.png'\n[materials.floor]\ncolor = 1\n"
    )
    more = {"environment": {"radiance": [0.5, 0.5, 0.5]}, "materials": {"floor": {"roughness": 0.5}}}  # in its place
    (tmp_path / "a.toml").write_text(scene_text({"base": str(tmp_path / "bare.toml"), **more}))
    more["materials"]["wall"] = {"color_texture": str(tmp_path / "a.png")}  # beside the base
    assert read_toml(tmp_path / "a.toml") == {"fps": 60, **more}


def test_objects_that_are_drawn_join_those_of_the_base(tmp_path):
    more = {"name": "more", "shape": "box", "size": [0.1, 0.1, 0.1]}
    path = tmp_path / "a.toml"
    path.write_text(scene_text({"base": "two-boxes", "objects": [more]}))
    assert len(load_world(str(path)).instances) == len(load_world("two-boxes").instances) + 1


@pytest.mark.parametrize("name", sorted(set(bundled_specs()) - {"digits"}))
def test_bundled_specifications_make_scenes(tmp_path, name):
    spec = load_spec(name)
    for index in range(3):
        scene = tmp_path / f"{index}.toml"
        scene.write_text(scene_text(spec.sample(index).scene))
        world = load_world(str(scene))
        assert len(world.instances) >= 3
        assert not world.warnings


def test_a_bundled_specification_shows_the_users_pictures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"screens/\*\.png"):
        load_spec("digits")
    (tmp_path / "screens").mkdir()
    for number in range(3):
        Image.new("RGB", (340, 340), (63 + number,) * 3).save(tmp_path / "screens" / f"{number}.png")
    seen = set()
    for index in range(12):
        (tmp_path / "scene.toml").write_text(scene_text(load_spec("digits").sample(index).scene))
        world = load_world("scene.toml")
        assert len(world.instances) == 1 and not world.warnings
        seen |= set(re.findall(r"screens/(\d)\.png", (tmp_path / "scene.toml").read_text()))
    assert seen == {"0", "1", "2"}


def test_the_hash_hangs_on_all_but_the_count(tmp_path, monkeypatch):
    plain = spec_of(tmp_path)
    assert plain.job_hash(2) == spec_of(tmp_path, count=100).job_hash(2) != plain.job_hash(3)
    for old, new in (
        ("0.3", "0.31"),
        ("two-boxes", "cornell"),
        ("count = 6", "count = 6\nseeds = { noise = 1 }"),
        ("count = 6", "count = 6\nreject = { nearest_m = 1.0 }"),
        ("train = 0.5, test = 0.5", "train = 0.75, test = 0.25"),
        ("[run]", "[write]\nlayout = 'dsec'\n[run]"),
        ("[run]", "[write]\nalso = ['a.csv']\n[run]"),
    ):
        assert spec_of(tmp_path, _TEXT.replace(old, new)).digest != plain.digest, new
    digest = plain.digest
    monkeypatch.setattr("clsim.datasets.spec.VERSION", "0.0.1")  # which may make other events
    assert plain.digest != digest


def test_options_of_a_run_are_drawn_from_the_sensors_stream(tmp_path):
    plain, sensor, scene = (
        spec_of(tmp_path, f"seeds = {{ {seeds} }}\n{_TEXT}").sample(0) for seeds in ("", "sensor = 1", "scene = 1")
    )
    assert plain.run == scene.run and plain.run["threshold"] != sensor.run["threshold"]
    assert plain.scene == sensor.scene


def test_a_part_without_a_share_is_none(tmp_path):
    """What is held out is shared out over the others."""
    text = _TEXT.replace("test = 0.5", "val = 0, test = 0.5")
    assert spec_of(tmp_path, text).parts == (("train", 0.5), ("test", 0.5))


def test_files_are_listed_from_the_specifications_folder(tmp_path):
    (tmp_path / "models" / "more").mkdir(parents=True)
    for name in ("more/b.glb", "a.glb"):
        (tmp_path / "models" / name).touch()
    text = 'scene.objects = [{ file = { files = "models/**/*.glb", held_out = %s } }]\nsplit = { a = 0.5, b = 0.5 }\n'
    both = [str(tmp_path / "models" / name) for name in ("a.glb", "more/b.glb")]
    for held_out in ("false", "true"):
        spec = spec_of(tmp_path, text % held_out)
        assert spec.scene["objects"][0]["file"]["choice"] == both, "in one order on all machines"
        drawn = {(sample.split, sample.scene["objects"][0]["file"]) for sample in map(spec.sample, range(20))}
        assert {file for _, file in drawn} == set(both) and len(drawn) == (2 if held_out == "true" else 4)


@pytest.mark.parametrize(
    "text",
    [
        "scene.materials.wall.color_texture = 'a.toml'",
        "scene.materials.wall.texture.file = 'a.toml'",
        "scene.lights = [{ picture = { frames = 'a.toml', fps = 3.0 } }]",
        "scene.environment.map = 'a.toml'",
        "scene.objects = [{ file = { choice = ['a.toml'] } }]",
        "scene.camera.trajectory = 'a.toml'",
        "scene.base = { choice = ['a.toml'] }",
        "run.camera_path = 'a.toml'",
        "run.imu_noise = 'a.toml'",
        "run.sensor = { choice = ['a.toml'] }",
    ],
)
def test_files_lie_beside_the_specification(tmp_path, text):
    """A sequence's scene is written elsewhere, and it is made in any folder of any machine."""
    assert repr(str(tmp_path / "a.toml")) in str(spec_of(tmp_path, text).sample(0))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("count = 0", "count must be a whole number"),
        ("count = true", "count must be a whole number"),
        ("cuont = 3", "no key 'cuont'; did you mean 'count'"),
        ("[run]\nduratoin_s = 1", "run.duratoin_s is no option of sequences; did you mean 'duration_s'"),
        ("[scene]\nfps = { unifrm = [1, 2] }", "scene.fps: there is no distribution 'unifrm'; did you mean 'uniform'"),
        ("[run]\nscene = 'x'", "run.scene is no option of sequences"),
        ("[run]\nsppp = 3", "run.sppp"),
        ("[run]\nseed = 3", "run.seed is no option of sequences"),
        ("[run]\noutputs = ['a.csv']", "run.outputs is no option of sequences"),
        *(
            (f"[run]\n{option} = 1", f"run.{option} is no option of sequences")
            for option in ("strict", "threads", "opencl", "loop", "pace", "governor", "ring")
        ),
        ("scene = 3", "scene must be a table"),
        ("scene.objects = [{}, { size = { uniform = [1] } }]", r"scene.objects\[1\].size: uniform must be two numbers"),
        ("split = { a = 0.5, b = 0.49 }", "add up to 1, got 0.99"),
        ("split = { a = 'x' }", "split must have a share"),
        ("[reject]\nflow_p95_px = [0, 1]", "needs run.truth to hold 'flow'"),
        ("[reject]\nmoving_share = [0, 1]", "needs run.truth to hold 'flow'"),
        ("[reject]\nnearest_m = 1", "needs run.truth to hold 'depth'"),
        ("run.truth = 'all'\nreject.nearest_m = 1\nwrite.layout = 'dsec'", "and the layout h5"),
        ("[reject]\nattempts = 0", "`attempts` must be at least 1"),
        ("[write]\nlayout = 'rosbag'", "`layout`"),
        ("[write]\nalso = ['../x.csv']", "write.also"),
        ("[write]\nalso = ['job.json']", "write.also"),
        ("[write]\nalso = ['events.csv', 'scene.toml']", "write.also"),
        ("[scene.camera]\nposition = { uniform = [1] }", "scene.camera.position: uniform"),
        ("count = ", "is no TOML"),
    ],
)
def test_what_is_no_specification(tmp_path, text, sentence):
    with pytest.raises(InputError, match=sentence) as told:
        spec_of(tmp_path, text)
    assert "a.toml" in str(told.value)


@pytest.mark.parametrize("truth", ["'all'", "['depth']", "'depth'"])
def test_rules_find_the_truth_that_they_need(tmp_path, truth):
    spec_of(tmp_path, f"[run]\ntruth = {truth}\n[reject]\nnearest_m = 1.0")


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path):
    """As editors on Windows write it."""
    assert spec_of(tmp_path, "\ufeffcount = 7").count == 7 and spec_of(tmp_path, "").count == 1


def test_a_count_that_is_given_replaces_the_files(tmp_path):
    assert spec_of(tmp_path, "count = 7", count=10_000_000).count == 10_000_000
    for none in (0, 10_000_001):
        with pytest.raises(InputError, match=f"from 1 to 10000000, got {none}"):
            spec_of(tmp_path, "count = 7", count=none)


def test_a_name_that_is_none():
    with pytest.raises(InputError, match=r"expected a \.toml file or one of digits, flicker, flow, indoor-depth"):
        load_spec("flwo")


names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=8)
values = st.recursive(
    st.booleans() | st.integers(-(2**62), 2**62) | st.floats(allow_nan=False, allow_infinity=False) | names,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(names, values, max_size=4))
def test_toml_comes_back(tmp_path_factory, table):
    path = tmp_path_factory.mktemp("toml") / "a.toml"
    path.write_text(to_toml(table), encoding="utf-8")
    assert read_toml(path) == table


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ({"base": "a.obj"}, "scene.base a.obj: must be a bundled scene or a .toml"),
        ({"base": "none.toml"}, "none.toml: cannot be read (No such file or directory)"),
        ({"fps": float("inf")}, "inf is no number for a scene"),
        ({"name": None}, "None cannot stand in a scene"),
    ],
)
def test_what_is_no_scene_is_told(scene, said):
    with pytest.raises(InputError, match=re.escape(said)):
        scene_text(scene)


def test_a_sensor_may_be_a_preset(tmp_path):
    assert spec_of(tmp_path, "run.sensor = 'davis346'").sample(0).run["sensor"] == "davis346"
