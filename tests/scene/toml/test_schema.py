"""The scene's TOML: what it means, what it refuses, and how it says so."""

import math

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.toml.schema import SceneTable, key_table

CAMERA = "[camera]\nposition = [0.0, 0.0, 3.0]\n"
BOX = '[[objects]]\nshape = "box"\n'


def load(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return load_world(path)


def warned(tmp_path, text):
    return load(tmp_path, text).warnings


def complaint(tmp_path, text):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["camera: is missing"]),
        ("[camera\n", ["not valid TOML", "line 1"]),
        (CAMERA + "fov = 50\n", ["camera.fov", "unknown key", "'fov_deg'"]),
        ("colour = 3\n" + CAMERA, ["colour: unknown key", "sphere_lights"]),
        (CAMERA + "fov_deg = .5\n", ["a number needs a digit before and after its point, as 0.1"]),
        (CAMERA + "fov_deg = 180\n", ["camera.fov_deg", "less than 180", "180"]),
        (CAMERA + "fov_deg = nan\n", ["camera.fov_deg", "finite", "nan"]),
        (CAMERA + "fov_deg = '50'\n", ["camera.fov_deg", "valid number", "'50'"]),
        (CAMERA + "resolution = [0, 10]\n", ["camera.resolution[0]", "greater than or equal to 1", "0"]),
        (
            CAMERA + "resolution = [64]\n",
            ["camera.resolution: expected two whole numbers such as [640, 480], got [64]"],
        ),
        (
            CAMERA + "resolution = '640x480'\n",
            ["camera.resolution: expected two whole numbers such as [640, 480], got '640x480'"],
        ),
        (
            CAMERA + "[environment]\nradiance = 1.0\n",
            ["environment.radiance: expected three numbers such as [", "got 1.0"],
        ),
        (
            CAMERA + "[objects]\nshape = 'box'\n",
            ["objects: expected tables: write [[objects]] with two brackets, got {"],
        ),
        ("[camera.keyframes]\ntime_s = 1\n", ["expected tables: write [[camera.keyframes]] with two brackets"]),
        (
            "[camera]\nkeyframes = [{time_s = 0.0, position = []}, {time_s = 1.0, position = [0, 0, 0, 1]}]\n",
            [f"camera.keyframes[{i}].position: expected three numbers such as [" for i in (0, 1)],
        ),
        (CAMERA + "[camera.lens]\ndistortion = 1.0\n", ["camera.lens.distortion: expected a list, got 1.0"]),
        (CAMERA + "[materials.m]\nnonlinear = 1\n", ["materials.m.nonlinear: expected true or false, got 1"]),
        (
            CAMERA + "[materials.m]\nbump_texture = 'h.png'\n",
            ["materials.m.bump_texture: expected a table of keys, got 'h.png'"],
        ),
        ("[camera]\nposition = [0.0, inf, 0.0]\n", ["camera.position[1]", "finite", "inf"]),
        ("[camera]\nresolution = [8, 8]\n", ["camera: expected one of position, keyframes, orbit and trajectory"]),
        (CAMERA + "look_at = [0.0, 0.0, 3.0]\n", ["camera: position and look_at meet"]),
        (CAMERA + "look_at = [0.0, 0.0, 0.0]\nrotation_deg = [0.0, 0.0, 0.0]\n", ["camera: has look_at and rotation"]),
        (CAMERA + "keyframes = [{time_s = 0.0, position = [0, 0, 0]}]\n", ["camera: has position and keyframes"]),
        (CAMERA + "[sensor]\nthreshold_on = -0.2\n", ["sensor.threshold_on", "greater than 0", "-0.2"]),
        (CAMERA + BOX + "colour = 1\n", ["objects[0].colour: unknown key"]),
        (CAMERA + BOX + "siez = [1, 1, 1]\n", ["objects[0].siez", "did you mean 'size'"]),
        (CAMERA + BOX + "radius_m = 1.0\n", ["objects[0].radius_m: unknown key"]),
        (CAMERA + BOX + "size = [1, -1, 1]\n", ["objects[0].size[1]", "greater than 0", "-1"]),
        (CAMERA + BOX + 'material = "gold"\n', ["objects[0].material", "'gold'", "none are defined"]),
        (CAMERA + "[[objects]]\nshape = 'cone'\n", ["objects[0]", "'box', 'quad', 'sphere'", "'cone'"]),
        (CAMERA + "[[objects]]\nname = 'x'\n", ["objects[0]", "either a file or a shape"]),
        (CAMERA + "[[objects]]\nfile = 'none.obj'\n", ["objects[0]", "none.obj", "missing"]),
        (CAMERA + "[[objects]]\nfile = '../up.obj'\n", ["objects[0]", "'../up.obj'", "missing"]),
        (CAMERA + "[[objects]]\nfile = 'http://x/a.obj'\n", ["objects[0]", "address"]),
        (CAMERA + BOX + "keyframes = []\n", ["objects[0].keyframes", "at least 1"]),
        (
            CAMERA + BOX + "keyframes = [{time_s = 1, position = [0, 0, 0]}, {time_s = 1, position = [1, 0, 0]}]\n",
            ["objects[0].keyframes: times must increase, got 1, 1"],
        ),
        (
            CAMERA
            + BOX
            + "keyframes = [{time_s = 0, position = [0,0,0], look_at = [0,0,1], rotation_deg = [0,0,0]}]\n",
            ["objects[0].keyframes[0]: has rotation_deg and look_at"],
        ),
        (
            CAMERA
            + BOX
            + "keyframes = [{time_s = 0, position = [0,0,0], look_at = [0,0,1]}, {time_s = 1, position = [0,0,0]}]\n",
            ["objects[0].keyframes: some have look_at and some do not"],
        ),
        (CAMERA + "[materials.a]\ncolor = [2, 0, 0]\n", ["materials.a.color[0]", "less than or equal to 1"]),
        (
            CAMERA + "[materials.a]\ncolor = [1, 0, 0]\nchecker = {color_a = [1, 1, 1], color_b = [0, 0, 0]}\n",
            ["materials.a: has color and checker"],
        ),
        (CAMERA + "[[sphere_lights]]\nradius_m = 0\nradiance = [1, 1, 1]\n", ["sphere_lights[0].radius_m"]),
        ("fps = 0\n" + CAMERA, ["fps", "greater than 0"]),
        ("objects = 3\n" + CAMERA, ["objects"]),
        ("camera = 3\n", ["camera"]),
        ("materials = [1]\n" + CAMERA + BOX, ["materials"]),
    ],
)
def test_each_mistake_is_named_with_file_key_and_value(tmp_path, text, parts):
    message = complaint(tmp_path, text)
    assert all("scene.toml" in line for line in message.splitlines())
    for part in parts:
        assert part in message


def test_all_mistakes_are_told_at_once_one_line_each(tmp_path):
    text = (
        "fps = -1\nwrong = 1\n[camera]\nfov_deg = nan\nposition = [0, 0, 3]\nlook_at = 3\n"
        + BOX
        + 'material = "gold"\nsize = [0, 1, 1]\n'
        + "[[sphere_lights]]\nradius_m = 1.0\n"
    )
    lines = complaint(tmp_path, text).splitlines()
    keys = sorted(line.split(": ")[1] for line in lines)
    assert keys == [
        "camera.fov_deg",
        "camera.look_at",
        "fps",
        "objects[0].material",
        "objects[0].size[0]",
        "sphere_lights[0].radiance",
        "wrong",
    ]


def test_mistakes_in_several_files_and_motions_are_told_at_once(tmp_path):
    (tmp_path / "bad.ply").write_bytes(b"nothing")
    text = CAMERA + "look_at = [0, 0, 3]\n[[objects]]\nfile = 'bad.ply'\n[[objects]]\nfile = 'none.obj'\n"
    lines = complaint(tmp_path, text).splitlines()
    assert len(lines) == 3
    assert ["bad.ply" in lines[0], "none.obj" in lines[1], "camera" in lines[2]] == [True] * 3


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "text",
    [
        "[camera]\nposition = [1e300, 0, 0]\n",
        f"[camera]\nposition = [1{'0' * 400}, 0, 0]\n",
        CAMERA + BOX + "size = [1e-30, 1e60, 1]\n",
    ],
)
def test_numbers_too_large_for_32_bits_are_refused_without_a_warning(tmp_path, text):
    complaint(tmp_path, text)


@pytest.mark.parametrize("data", [b"\xff\xfe", b"x = " + b"[" * 100_000, b"#" * (17 << 20)])
def test_what_is_no_toml_is_refused(tmp_path, data):
    path = tmp_path / "scene.toml"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"scene\.toml"):
        load_world(path)


@pytest.mark.parametrize(("fov_deg", "written"), [(0.87, "49.85"), (2.0, None)])
def test_a_field_of_view_in_radians_is_suspected(tmp_path, fov_deg, written):
    world = load(tmp_path, CAMERA + f"fov_deg = {fov_deg}\n" + '[[cameras]]\nname = "a"\nfov_deg = 1.0\n')
    said = [f"scene.toml: camera.fov_deg is 0.87° (if it is in radians, write {written})"] if written else []
    assert [each for each in world.warnings if "fov_deg" in each] == [
        *said, "scene.toml: cameras[0].fov_deg is 1° (if it is in radians, write 57.3)"
    ]  # fmt: skip


def test_values_reach_the_world(tmp_path):
    world = load(
        tmp_path,
        """
        fps = 60
        duration_s = 3.5
        [camera]
        resolution = [20, 10]
        fov_deg = 70
        shutter_s = 0.01
        position = [0, 0, 3]
        [environment]
        radiance = [0.1, 0.2, 0.3]
        [sensor]
        threshold_on = 0.3
        threshold_off = 0.4
        scale = 2.0
        floor = 0.01
        [materials.glow]
        color = [0.1, 0.2, 0.3]
        emission = [1, 2, 3]
        emits_behind = false
        back = "culled"
        [materials.squares]
        checker = { color_a = [1, 0, 0], color_b = [0, 0, 1], squares_per_m = 3 }
        [[objects]]
        name = "ball"
        shape = "sphere"
        radius_m = 2
        segments = 32
        scale = [1, 2, 3]
        position = [1, 2, 3]
        rotation_deg = [0, 90, 0]
        material = "glow"
        [[objects]]
        shape = "quad"
        material = "squares"
        [[objects]]
        shape = "quad"
        [[sphere_lights]]
        radius_m = 0.25
        radiance = [4, 5, 6]
        orbit = { center = [0, 1, 0], radius_m = 2, period_s = 4 }
        """,
    )
    assert (world.fps, world.duration_s) == (60, 3.5)
    camera, sensor, light = world.camera, world.sensor, world.sphere_lights[0]
    assert (camera.width, camera.height, camera.fov_deg, camera.shutter_s) == (20, 10, 70, 0.01)
    assert world.environment == (0.1, 0.2, 0.3)
    assert (sensor.threshold_on, sensor.threshold_off, sensor.scale, sensor.floor) == (0.3, 0.4, 2, 0.01)
    assert (light.radius_m, light.radiance) == (0.25, (4, 5, 6))
    np.testing.assert_allclose(light.motion.pose(1.0)[:3, 3], (2, 1, 0), atol=1e-12)
    ball, squares, plain = (world.meshes[instance.mesh] for instance in world.instances)
    assert world.instances[0].name == "ball"
    np.testing.assert_allclose(ball.vertices.max(axis=0), (2, 4, 6), rtol=1e-5)
    np.testing.assert_allclose(world.instances[0].motion.pose(0.0) @ (0, 0, 1, 1), (2, 2, 3, 1), atol=1e-12)
    np.testing.assert_array_equal([each.motion.pose(0.0) for each in world.instances[1:]], [np.eye(4)] * 2)
    glow = world.materials[ball.material_ids[0]]
    assert (glow.color, glow.emission, glow.emits_behind, glow.back) == ((0.1, 0.2, 0.3), (1, 2, 3), False, "culled")
    checker = world.materials[squares.material_ids[0]]
    assert (checker.color, checker.emits_behind, checker.back) == ((1, 1, 1), True, "same")
    texture = world.textures[checker.texture]
    assert (texture.color_a, texture.color_b, texture.scale) == ((1, 0, 0), (0, 0, 1), 3)
    assert world.materials[plain.material_ids[0]].color == (0.5, 0.5, 0.5)


def test_duration_is_that_of_the_longest_motion_and_a_second_where_nothing_moves(tmp_path):
    assert load(tmp_path, CAMERA).duration_s == 1.0
    keys = "keyframes = [{time_s = 0, position = [0, 0, 0]}, {time_s = 1.5, position = [1, 0, 0]}]\n"
    orbit = "[[sphere_lights]]\nradius_m = 1\nradiance = [1, 1, 1]\norbit = {center = [0, 0, 0], radius_m = 1, "
    assert load(tmp_path, CAMERA + BOX + keys).duration_s == 1.5
    assert load(tmp_path, CAMERA + BOX + keys + orbit + "period_s = 4, degrees = 180}\n").duration_s == 2.0


def test_a_camera_looks_where_it_is_told(tmp_path):
    """The three ways to say it agree with geometry: the target lies on the camera's −z axis."""
    target = np.array((1.0, 0.5, -2.0))
    orbit = "orbit = {center = [1.0, 0.5, -2.0], radius_m = 2, height_m = 1, period_s = 1}\n"
    keys = "keyframes = [{time_s = 0, position = [0, 0, 3]}, {time_s = 1, position = [3, 1, 3]}]\n"
    for text in (
        "[camera]\nposition = [0, 0, 3]\nlook_at = [1.0, 0.5, -2.0]\n",
        "[camera]\n" + orbit,
        "[camera]\nlook_at = [1.0, 0.5, -2.0]\n" + keys,
    ):
        pose = load(tmp_path, text).camera.motion.pose(0.3)
        local = np.linalg.inv(pose) @ (*target, 1)
        assert local[:2] == pytest.approx((0, 0), abs=1e-9)
        assert local[2] < 0
    turned = load(tmp_path, CAMERA + "rotation_deg = [0, 90, 0]\n").camera.motion.pose(0.0)
    np.testing.assert_allclose(-turned[:3, 2], (-1, 0, 0), atol=1e-12)


def test_keyframed_rotations_by_angles_and_by_quaternions_agree(tmp_path):
    half = math.sqrt(0.5)
    texts = (
        BOX + "keyframes = [{time_s = 0, position = [0, 0, 0]}, "
        "{time_s = 1, position = [1, 0, 0], rotation_deg = [0, 90, 0]}]\n",
        BOX + "keyframes = [{time_s = 0, position = [0, 0, 0], quaternion = [0, 0, 0, 1]}, "
        f"{{time_s = 1, position = [1, 0, 0], quaternion = [0, {half}, 0, {half}]}}]\n",
    )
    first, second = (load(tmp_path, CAMERA + text).instances[0].motion.pose(0.4) for text in texts)
    np.testing.assert_allclose(first, second, atol=1e-12)
    assert math.degrees(math.atan2(first[0, 2], first[0, 0])) == pytest.approx(36)


def test_the_key_table_names_every_top_level_key():
    table = key_table()
    for key in SceneTable.model_fields:
        assert f"| {key} |" in table


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("kind", "`point`, `spot`, `directional`"),
        ("kind", "`diffuse`, `conductor`, `dielectric`, `thin-dielectric`, `plastic`, `principled`"),
        ("interpolation", "`linear`, `cubic`"),
        ("wrap", "`repeat`, `clamp`, `mirror`"),
        ("alpha_mode", "`opaque`, `mask`, `blend`"),
        ("model", "`perspective`, `fisheye`"),
        ("metal", "Ag, Al, AlAs, AlSb, Au"),
    ],
)
def test_the_key_table_lists_what_a_key_may_be(key, values):
    assert any(line.startswith(f"| {key} |") and values in line for line in key_table().splitlines())


def test_wrong_counts_are_told_in_plain_words(tmp_path):
    with pytest.raises(InputError) as caught:
        load(tmp_path, CAMERA + "[camera.lens]\ndistortion = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]\n")
    assert "camera.lens.distortion: expected at most 5 items, got [1.0" in str(caught.value)


def test_keys_that_were_renamed_say_so(tmp_path):
    path = tmp_path / "old.toml"
    path.write_text("[camera]\nposition = [0, 0, 1]\n[materials.a]\ntwo_sided = false\n")
    with pytest.raises(InputError) as caught:
        load_world(path)
    assert "materials.a.two_sided: is no longer a key: expected emits_behind" in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_mark_of_the_byte_order_is_no_text(tmp_path):
    path = tmp_path / "marked.toml"
    path.write_bytes(b"\xef\xbb\xbf[camera]\nposition = [0, 0, 1]\n[environment]\nradiance = [1, 1, 1]\n")
    assert load_world(path).environment == (1.0, 1.0, 1.0)


def test_files_that_are_no_scenes_are_not_said_to_be_missing(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"")
    with pytest.raises(InputError, match=r"a\.mat: is no scene that clsim reads \(\.mat\), expected one of \.toml"):
        load_world(tmp_path / "a.mat")


def test_a_list_whose_items_are_wrong_is_not_also_said_to_be_short(tmp_path):
    keys = BOX + "keyframes = [{time_s = 0.0, PLACE}, {time_s = 1.0, PLACE}]\n"
    keys = keys.replace("PLACE", "position = [0, 0, 0], rotation = [0, 0, 0]")
    said = complaint(tmp_path, CAMERA + keys).splitlines()
    assert len(said) == 2 and all("rotation: unknown key, did you mean 'rotation_deg'?" in line for line in said)
    assert "keyframes: expected at least 1 item, got []" in complaint(tmp_path, CAMERA + BOX + "keyframes = []\n")


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("opacity = 0.5", "opacity changes nothing without alpha_mode"),
        ("alpha_cutoff = 0.2", "alpha_cutoff changes nothing without alpha_mode"),
        ("bump_scale = 2.0", "bump_scale changes nothing without bump_texture"),
        ("normal_scale = 2.0", "normal_scale changes nothing without normal_texture"),
        ("kind = 'conductor'\nmetal = 'Au'\ncolor = [1, 0, 0]", "color changes nothing beside metal"),
    ],
)
def test_keys_of_a_material_that_change_nothing_are_told(tmp_path, table, sentence):
    text = f"{CAMERA}[materials.m]\n{table}\n{BOX}material = 'm'\n"
    assert [f"scene.toml: materials.m.{sentence}"] == [each for each in warned(tmp_path, text) if "materials" in each]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (CAMERA + "sensor_width_mm = 20.0\n", "camera.sensor_width_mm changes nothing without focal_length_mm"),
        (CAMERA + "trajectory_axes = 'opengl'\n", "camera.trajectory_axes changes nothing without trajectory"),
        (CAMERA + "[environment]\nmap_scale = 2.0\n", "environment.map_scale changes nothing without map"),
        (
            "[camera]\nlook_at = [0, 0, 0]\n"
            "keyframes = [{time_s = 0, position = [0, 0, 1], rotation_deg = [0, 9, 0]}]\n",
            "camera.look_at changes nothing beside keyframes that turn",
        ),
        (
            "[camera]\nrotation_deg = [0, 9, 0]\n"
            "orbit = {center = [0, 0, 0], radius_m = 1, period_s = 1, look_at = [0, 0, 0]}\n",
            "camera.rotation_deg changes nothing beside an orbit with look_at",
        ),
        (
            CAMERA + "[[lights]]\nkind = 'point'\nintensity = [1, 1, 1]\nouter_deg = 20\n",
            "lights[0].outer_deg changes nothing but of a spot",
        ),
    ],
)
def test_keys_that_change_nothing_are_told(tmp_path, text, sentence):
    assert f"scene.toml: {sentence}" in warned(tmp_path, text)


def test_the_turn_of_a_camera_on_an_orbit_that_looks_nowhere_counts(tmp_path):
    orbit = "[camera]\nrotation_deg = [0, 9, 0]\norbit = {center = [0, 0, 0], radius_m = 1, period_s = 1}\n"
    assert not any("changes nothing" in sentence for sentence in warned(tmp_path, orbit))
