"""MuJoCo's models in clsim, value by value: against its own data, its documentation, and glTF as another reader."""

import math
from pathlib import Path

import numpy as np
import pytest

import clsim
from clsim.errors import InputError
from clsim.scene import Material, World, load_world
from clsim.scene.pictures.images import decode_srgb
from tests.scene.gltf.gltf_files import gltf, write_gltf

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")

from clsim.bridges.mujoco import MujocoScene  # noqa: E402

UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From MuJoCo's axes to ours."""
MOVING = """<mujoco><option timestep=".001"/><worldbody>
  <camera name="fixed" pos="0 -3 1"/>
  <geom type="box" size="1 1 .1"/>
  <body name="arm" pos="0 .4 2"><joint type="ball"/><geom type="capsule" fromto="0 0 0 .2 0 -.7" size=".06"/>
    <camera name="on arm" pos=".1 .2 .3" euler="10 20 30"/><light name="lamp" pos=".1 0 0" dir="1 2 -3"/>
    <body name="tip" pos=".1 0 -.9" euler="0 40 0"><joint axis="0 1 1"/><geom size=".1"/></body></body>
  <body name="free" pos=".9 -.3 .5"><freejoint/><geom type="ellipsoid" size=".1 .2 .3"/></body>
  <body name="ghost" mocap="true" pos="1 1 1"><geom size=".15"/></body>
  <body name="held" mocap="true" pos="1 1 2">
    <body name="in hand" pos="0 .2 .1" euler="5 6 7"><geom size=".1"/></body></body>
</worldbody></mujoco>"""


def load(text: str) -> tuple[object, object]:
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def expected(data: object, body: str) -> np.ndarray:
    found = data.body(body)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = UP @ found.xmat.reshape(3, 3), UP @ found.xpos
    return pose


@pytest.mark.parametrize("camera", ["fixed", "on arm"])
def test_all_that_can_move_is_where_mujoco_has_it(camera: str) -> None:
    """Swinging, free and mocap bodies, with what they carry, lamps and the camera, a step of MuJoCo's at a time."""
    model, data = load(MOVING)
    data.qpos[:4] = (0.6, 0.2, -0.7, 0.33)
    scene = MujocoScene(model, data, camera=camera, resolution=(8, 6))
    own = mujoco.MjData(model)
    with clsim.Simulator(scene.world, clock="caller", quality="draft") as run:
        for step in range(1, 6):
            data.mocap_pos[:] = (0.1 * step, 0.2, 1.0), (0.5, -0.1 * step, 2.0)
            data.mocap_quat[1] = (math.cos(0.2 * step), 0.0, math.sin(0.2 * step), 0.0)
            data.ctrl[:] = 0
            mujoco.mj_step(model, data)
            assert scene.follow(run) == 1000 * step
            for name in ("time", "qpos", "mocap_pos", "mocap_quat"):
                value = getattr(data, name)
                setattr(own, name, value) if name == "time" else getattr(own, name).__setitem__(..., value)
            mujoco.mj_forward(model, own)
            for body in ("arm", "tip", "free", "ghost", "held", "in hand"):
                if body != "held":  # nothing to be seen of it
                    np.testing.assert_allclose(run.pose(body, 1000 * step), expected(own, body), atol=1e-9)
            seen = run.pose("camera", 1000 * step)
            np.testing.assert_allclose(seen[:3, :3], UP @ own.cam(camera).xmat.reshape(3, 3), atol=1e-9)
            np.testing.assert_allclose(seen[:3, 3], UP @ own.cam(camera).xpos, atol=1e-9)
            lamp = run.pose("light:lamp", 1000 * step)
            np.testing.assert_allclose(lamp[:3, 3], UP @ own.light("lamp").xpos, atol=1e-9)
            np.testing.assert_allclose(-lamp[:3, 2], UP @ own.light("lamp").xdir, atol=1e-9)


def test_time_is_the_datas_since_the_scene_was_made_rounded() -> None:
    model, data = load(MOVING.replace('timestep=".001"', 'timestep=".0123456"'))
    mujoco.mj_step(model, data)
    scene = MujocoScene(model, data, resolution=(8, 6))
    times = []
    for _ in range(5):
        times.append(scene.time_us)
        mujoco.mj_step(model, data)
    assert times == [round(12345.6 * k) for k in range(5)]


def material(tmp_path: Path, attributes: str, geom: str = "") -> tuple[Material, World]:
    text = f'<mujoco><asset><material name="m" {attributes}/></asset><worldbody><geom size=".1" material="m" {geom}/>'
    world = MujocoScene(*load(text + "</worldbody></mujoco>"), resolution=(8, 6)).world
    return world.materials[int(world.meshes[0].material_ids[0])], world


@pytest.mark.parametrize(("metallic", "roughness"), [(0.25, 0.5), (1.0, 0.3), (0.0, 0.9), (0.5, 0.0)])
def test_metals_and_roughness_are_those_of_gltf(tmp_path: Path, metallic: float, roughness: float) -> None:
    """MuJoCo's documentation calls them physically based; exporters write the same numbers into both files."""
    ours, _ = material(tmp_path, f'metallic="{metallic}" roughness="{roughness}" rgba="1 1 1 1"')
    factors = {"metallicFactor": metallic, "roughnessFactor": roughness}
    tree = gltf(
        materials=[{"pbrMetallicRoughness": factors}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
    )
    (theirs,) = load_world(write_gltf(tmp_path, tree)).materials
    assert (ours.metallic, ours.alpha) == pytest.approx((theirs.metallic, theirs.alpha), abs=1e-4)
    assert ours.kind == theirs.kind == "principled"


@pytest.mark.parametrize(
    ("told", "seen"),
    [
        ("", ("diffuse", 0.0, None)),
        ('metallic=".4"', ("principled", 0.4, 1.0)),
        ('roughness=".3"', ("principled", 0.0, 0.09)),
        ('metallic="-1" roughness="-1"', ("diffuse", 0.0, None)),
        ('metallic="1" roughness="0"', ("principled", 1.0, 0.0)),
    ],
)
def test_of_metal_and_roughness_either_may_be_told_alone(
    tmp_path: Path, told: str, seen: tuple[str, float, float | None]
) -> None:
    """Below 0 is not told: no metal, and as rough as can be."""
    found, _ = material(tmp_path, told)
    kind, metallic, alpha = seen
    assert (found.kind, found.metallic) == (kind, pytest.approx(metallic))
    assert alpha is None or found.alpha == pytest.approx(alpha)


def test_colours_are_of_the_geom_else_of_its_material_and_emission_is_a_share_of_them(tmp_path: Path) -> None:
    (own, _), (shared, _), (lit, _) = (
        material(tmp_path, 'rgba=".2 .4 .6 1"', 'rgba=".7 .5 .1 .25"'),
        material(tmp_path, 'rgba=".2 .4 .6 .5"'),
        material(tmp_path, 'rgba=".2 .4 .6 1" emission=".3"'),
    )
    assert own.color == pytest.approx(decode_srgb(np.array((0.7, 0.5, 0.1))), rel=1e-6)
    assert shared.color == pytest.approx(decode_srgb(np.array((0.2, 0.4, 0.6))), rel=1e-6)
    assert [(each.alpha_mode, each.opacity) for each in (own, shared)] == [("blend", 0.25), ("blend", 0.5)]
    assert lit.emission == pytest.approx(0.3 * decode_srgb(np.array((0.2, 0.4, 0.6))), rel=1e-6)


PLANE = """<mujoco><asset>
  <texture name="t" type="2d" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="8" height="8"/>
  <material name="m" texture="t" texrepeat="3 5" texuniform="{uniform}"/></asset>
  <worldbody><geom type="{kind}" size="2 .5 .1" material="m"/></worldbody></mujoco>"""


@pytest.mark.parametrize("role", ["rgb", "rgba"])
def test_a_layer_of_colours_is_the_texture_of_its_material(role: str) -> None:
    layer = f'<material name="m"><layer role="{role}" texture="t"/></material>'
    told = PLANE.format(uniform="false", kind="plane")
    told = told.replace('<material name="m" texture="t" texrepeat="3 5" texuniform="false"/>', layer)
    assert layer in told
    world = MujocoScene(*load(told), resolution=(8, 6)).world
    (texture,) = world.textures
    assert texture.pixels.shape == (8, 8, 4) and np.ptp(texture.pixels[..., 0]) > 100


@pytest.mark.parametrize("kind", ["plane", "box"])
@pytest.mark.parametrize("uniform", ["false", "true"])
def test_textures_repeat_over_a_face_or_over_two_metres(kind: str, uniform: str) -> None:
    """MuJoCo's XML reference tells of one spatial unit with texuniform; its renderer takes half sizes, that is two."""
    world = MujocoScene(*load(PLANE.format(uniform=uniform, kind=kind)), resolution=(8, 6)).world
    (mesh,) = world.meshes
    texture = world.textures[world.materials[int(mesh.material_ids[0])].texture]
    flat = (mesh.vertices[mesh.triangles][..., 2] == mesh.vertices[:, 2].max()).all(axis=1)
    top = np.unique(mesh.triangles[flat])  # the face that looks up
    places = mesh.vertices[top].astype(np.float64)
    found = np.column_stack([mesh.uvs[top], np.ones(len(top))]) @ np.array(texture.uv_matrix).T
    corner = np.lexsort((places[:, 1], places[:, 0]))
    least, most = found[corner[0]], found[corner[-1]]
    across, along = (3, 5) if uniform == "false" else (3 * 2.0, 5 * 0.5)
    assert sorted(np.abs(most - least)) == pytest.approx(sorted((across, along)))
    if kind == "plane":
        assert np.abs(most - least) == pytest.approx((across, along))


LAMPS = """<mujoco><statistic center="1 2 .5"/><worldbody><geom size=".1"/>
  <light name="lamp" pos="1 -1 4.5" dir="0 0 -1" diffuse=".6 .3 .9" {more}/></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("more", "kind"),
    [('cutoff="180"', "point"), ('cutoff="35"', "spot"), ('cutoff="35" directional="true"', "directional")],
)
def test_lamps_light_the_models_middle_as_brightly_as_diffuse_says(more: str, kind: str) -> None:
    """A white surface there that faces the lamp has a radiance of diffuse: its irradiance is π times that."""
    world = MujocoScene(*load(LAMPS.format(more=more)), resolution=(8, 6)).world
    (lamp,) = world.punctual_lights
    middle, place = UP @ (1.0, 2.0, 0.5), lamp.motion.pose(0.0)[:3, 3]
    away2 = 1.0 if kind == "directional" else float(np.sum((place - middle) ** 2))
    assert lamp.kind == kind
    assert np.array(lamp.intensity) / away2 / math.pi == pytest.approx((0.6, 0.3, 0.9))
    if kind == "spot":
        assert lamp.outer_deg == 35 and 0 < lamp.inner_deg < 35


def test_ambient_light_is_that_of_all_lamps_that_shine() -> None:
    text = """<mujoco><visual><headlight ambient=".1 .2 .3" diffuse=".4 .4 .4" active="{on}"/></visual><worldbody>
      <geom size=".1"/><light ambient=".01 .02 .03" pos="0 0 2"/><light ambient=".5 .5 .5" active="false"/>
      <light ambient=".2 0 0" pos="0 0 3"/></worldbody></mujoco>"""
    shining, off = (MujocoScene(*load(text.format(on=on)), resolution=(8, 6)).world for on in (1, 0))
    assert shining.environment == pytest.approx((0.31, 0.22, 0.33))
    assert off.environment == pytest.approx((0.21, 0.02, 0.03))


def test_the_headlight_shines_from_the_camera_where_no_lamp_does() -> None:
    """A white wall that faces it is as bright as MuJoCo's diffuse light: π of that falls in, and 1/π of it goes out."""
    text = """<mujoco><visual><headlight diffuse=".4 .5 .6" active="{on}"/></visual><worldbody>
      <camera pos="1 2 3" euler="30 0 0"/><geom size=".1"/>{lamp}</worldbody></mujoco>"""
    cases = ((1, ""), (0, ""), (1, '<light name="lamp"/>'))
    shining, off, other = (
        MujocoScene(*load(text.format(on=on, lamp=lamp)), resolution=(8, 6)).world for on, lamp in cases
    )
    (light,) = shining.punctual_lights
    assert light.kind == "directional" and light.intensity == pytest.approx(np.multiply(math.pi, (0.4, 0.5, 0.6)))
    np.testing.assert_allclose(light.motion.pose(0.0)[:3, 2], shining.camera.motion.pose(0.0)[:3, 2], atol=1e-9)
    assert not off.punctual_lights and [each.name for each in other.punctual_lights] == ["light:lamp"]


def test_height_fields_are_as_high_as_mujocos_rays_find_them() -> None:
    """No two corners are alike, and no row is the mirror of another."""
    text = """<mujoco><asset><hfield name="other" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 1 1"/>
      <hfield name="h" nrow="3" ncol="3" size=".4 .3 .2 .1" elevation="0 1 2 6 4 7 3 8 5"/></asset><worldbody>
      <geom type="hfield" hfield="h"/></worldbody></mujoco>"""
    model, data = load(text)
    (hill,) = MujocoScene(model, data, resolution=(8, 6)).world.meshes
    top = hill.vertices[:9].astype(np.float64)  # the others are of its walls and floor
    assert np.ptp(top, axis=0) == pytest.approx((0.8, 0.6, 0.2))
    for x, y, z in top * (0.9999, 0.9999, 1.0):
        start, down, geom = np.array((x, y, 5.0)), np.array((0.0, 0.0, -1.0)), np.zeros(1, np.int32)
        found = mujoco.mj_ray(model, data, start, down, None, 1, -1, geom)
        assert 5.0 - (found if isinstance(found, float) else found[0]) == pytest.approx(z, abs=1e-3)


def test_planes_without_a_size_reach_far() -> None:
    """XML reference: a plane of size 0 has no end in that direction."""
    model, data = load('<mujoco><worldbody><geom type="plane" size="0 .5 .1"/></worldbody></mujoco>')
    (plane,) = MujocoScene(model, data, resolution=(8, 6)).world.meshes
    assert np.abs(plane.vertices[:, 0]).min() >= 9 * model.stat.extent
    assert np.abs(plane.vertices[:, 1]) == pytest.approx(0.5)


def test_a_meshs_own_coordinates_show_its_picture_from_the_top(tmp_path: Path) -> None:
    """An OBJ file means by vt .2 .9 what trimesh reads of it: u to the right, and v up."""
    import trimesh

    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt .1 .2\nvt .6 .3\nvt .2 .9\nvt .7 .8\n"
    text += "f 1/1 3/3 2/2\nf 1/1 2/2 4/4\nf 1/1 4/4 3/3\nf 2/2 3/3 4/4\n"
    (tmp_path / "a.obj").write_text(text)
    named = f'<mesh name="a" file="{tmp_path / "a.obj"}" inertia="shell"/>'
    picture = (
        '<texture name="t" type="2d" builtin="flat" rgb1="1 1 1" width="4" height="4"/><material name="m" texture="t"/>'
    )
    body = '<body><geom type="mesh" mesh="a" material="m"/></body>'
    model, data = load(f"<mujoco><asset>{named}{picture}</asset><worldbody>{body}</worldbody></mujoco>")
    (mesh,) = MujocoScene(model, data, resolution=(8, 6)).world.meshes
    own = trimesh.load(tmp_path / "a.obj", process=False)
    # MuJoCo moves a mesh to its centre of mass, and turns it: edges keep their lengths.
    length = {tuple(np.round(uv, 4)): point for uv, point in zip(mesh.uvs.tolist(), mesh.vertices, strict=True)}
    place = {tuple(np.round(uv, 4)): point for uv, point in zip(own.visual.uv.tolist(), own.vertices, strict=True)}
    assert set(length) == set(place) == {(0.1, 0.2), (0.6, 0.3), (0.2, 0.9), (0.7, 0.8)}
    for a in place:
        for b in place:
            assert np.linalg.norm(length[a] - length[b]) == pytest.approx(np.linalg.norm(place[a] - place[b]), abs=1e-5)


def test_frames_come_as_often_as_the_scene_was_told() -> None:
    assert MujocoScene(*load(MOVING), resolution=(8, 6), fps=250.0).world.fps == 250.0
    camera = MujocoScene(*load(MOVING)).world.camera
    assert (camera.width, camera.height) == (346, 260)


def test_a_model_and_its_data_in_the_wrong_order_are_told() -> None:
    model, data = load(MOVING)
    with pytest.raises(InputError, match="`model` must be an MjModel, got MjData"):
        MujocoScene(data, model)
    other = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    with pytest.raises(InputError, match="`data` is of another model: it has 1 bodies and 1 geoms, exp"):
        MujocoScene(model, mujoco.MjData(other))
    with pytest.raises(InputError, match="`resolution` must be a list of 2 whole numbers, got '8x6'"):
        MujocoScene(model, data, resolution="8x6")  # type: ignore[arg-type]
    assert MujocoScene(model, data, camera=np.int64(0)).world.camera.width == 346  # type: ignore[arg-type]


def test_where_time_stands_still_it_does_not_begin_again() -> None:
    """A place that a program changes by hand is followed at the same time; and later steps go on from there."""
    model, data = load(MOVING)
    scene = MujocoScene(model, data, resolution=(8, 6))
    with clsim.Simulator(scene.world, clock="caller", quality="draft") as run:
        times = []
        for steps in (0, 1, 0, 1):
            for _ in range(steps):
                mujoco.mj_step(model, data)
            times.append(scene.follow(run))
            run.step(times[-1])
    assert times == [0, 1000, 1000, 2000]


@pytest.mark.parametrize(("begun_s", "again_s"), [(5.0, 2.0), (5.0, 5.0005)])
def test_where_time_goes_back_it_begins_at_0_again(begun_s: float, again_s: float) -> None:
    """As in mj_resetDataKeyframe, which may leave another time than 0."""
    model, data = load(MOVING)
    data.time = begun_s
    scene = MujocoScene(model, data, resolution=(8, 6))
    with clsim.Simulator(scene.world, clock="caller", quality="draft") as run:
        mujoco.mj_step(model, data)
        assert scene.follow(run) == 1000
        mujoco.mj_resetData(model, data)
        data.time = again_s
        run.reset()
        assert scene.follow(run) == 0
        mujoco.mj_step(model, data)
        assert scene.follow(run) == 1000


def test_a_meshs_own_normals_are_those_that_its_file_numbers_for_each_corner() -> None:
    """One for each face, as of a body with edges, where points have none of their own."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
    faces = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    out = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    text = "".join("v {} {} {}\n".format(*point) for point in points)
    text += "".join("vn {} {} {}\n".format(*normal / np.linalg.norm(normal)) for normal in out)
    text += "".join("f " + " ".join(f"{i + 1}//{k + 1}" for i in face) + "\n" for k, face in enumerate(faces))
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><mesh name="a" file="a.obj"/></asset><worldbody><body><geom type="mesh" mesh="a"/></body>'
        "</worldbody></mujoco>",
        {"a.obj": text.encode()},
    )
    (mesh,) = MujocoScene(model, mujoco.MjData(model), resolution=(8, 6)).world.meshes
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    for k in range(3):
        np.testing.assert_allclose(mesh.normals[mesh.triangles[:, k]], flat, atol=1e-5)
