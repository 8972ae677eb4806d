"""Models of MuJoCo's from files, against its own steps and a body's free fall."""

from pathlib import Path

import numpy as np
import pytest

from clsim.errors import InputError
from clsim.scene import World, load_world
from clsim.scene.mujoco import course as mujoco_course
from clsim.scene.mujoco.model import ShownModel
from clsim.scene.mujoco.scene import is_mjcf
from clsim.scene.mujoco.shapes import mesh_of

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
PENDULUM = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="2 2 .1"/>
    <body name="rod" pos="0 0 1"><joint axis="0 1 0"/><geom size=".05 .3" pos=".3 0 0" type="capsule"/>
    <camera pos="0 -2 0" xyaxes="1 0 0 0 0 1"/><light name="torch" pos="0 -1 1"/></body></worldbody></mujoco>"""
FALL = """<mujoco><worldbody><light pos="0 0 3"/><body name="ball" pos=".1 .2 9"><freejoint/><geom size=".1"/></body>
    </worldbody></mujoco>"""
UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def saved(folder: Path, text: str) -> Path:
    path = folder / "robot.xml"
    path.write_text(text)
    return path


def load(folder: Path, text: str) -> World:
    return load_world(saved(folder, text))


def test_a_ball_falls_as_newton_says(tmp_path: Path) -> None:
    world = load(tmp_path, FALL)
    (ball,) = world.instances
    assert world.duration_s == 5.0 and world.camera.motion.duration_s == 0
    for time_s in (0.0, 0.1, 0.4321, 1.0):
        # The step's own error is first order: g/2 · timestep · t, with MuJoCo's 2 ms.
        height_m = 9.0 - 9.81 / 2 * time_s * (time_s + 0.002)
        assert ball.motion.pose(time_s)[:3, 3] == pytest.approx([0.1, height_m, -0.2], abs=1e-5)


@pytest.mark.parametrize(
    ("kind", "size"),
    [("sphere", ".3"), ("capsule", ".2 .5"), ("cylinder", ".4 .1"), ("ellipsoid", ".1 .2 .3"), ("box", ".1 .2 .3")],
)
def test_geoms_fill_mujocos_own_bounding_boxes(kind: str, size: str) -> None:
    text = f'<mujoco><worldbody><geom type="{kind}" size="{size}"/></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    mesh = mesh_of(model, 0)
    assert mesh is not None
    middle, half = model.geom_aabb[0].reshape(2, 3)
    np.testing.assert_allclose([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)], [middle - half, middle + half])


@pytest.mark.parametrize("welded", [False, True])
def test_what_a_mocap_body_carries_moves_with_it_also_where_it_counts_as_welded_to_the_world(welded: bool) -> None:
    """MuJoCo 3.6 tells no difference between a mocap body's weld and that of what stands still."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body name="fixed"><geom size=".1"/></body>
        <body name="hand" mocap="true"><geom size=".1"/><light name="torch"/><camera/>
        <body name="held" pos="1 0 0"><geom size=".1"/></body></body></worldbody></mujoco>""")
    if welded:
        model.body_weldid[:] = 0
    shown = ShownModel(model, mujoco.MjData(model), 0, (8, 6))
    shown.world("hand", None, 100.0)
    assert (list(shown.bodies.values()), list(shown.lights.values())) == (["hand", "held"], ["light:torch"])
    assert shown.camera_moves


@pytest.mark.slow
def test_all_is_where_mujocos_steps_lead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco_course, "_SPANS", 2)
    world = load(tmp_path, PENDULUM)
    rod = next(each for each in world.instances if each.name.startswith("rod/"))
    torch = next(each for each in world.punctual_lights if each.name == "light:torch")
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    times, found, seen, lit = [], [], [], []
    for step in range(3000):
        mujoco.mj_forward(model, data)
        if step % 250 == 130:
            times.append(0.002 * step)
            found.append(UP @ data.geom_xpos[1])
            seen.append(UP @ data.cam_xmat[0].reshape(3, 3))
            lit.append(UP @ data.light_xpos[1])
        mujoco.mj_step(model, data)
    assert np.ptp(found, axis=0).max() > 0.3, "it swings"
    poses = [rod.motion.pose(time_s) for time_s in times]
    assert np.array([pose[:3, 3] for pose in poses]) == pytest.approx(np.array(found), abs=1e-9)
    camera = [world.camera.motion.pose(time_s)[:3, :3] for time_s in times]
    assert np.array(camera) == pytest.approx(np.array(seen), abs=1e-9)
    lamps = [torch.motion.pose(time_s)[:3, 3] for time_s in times]
    assert np.array(lamps) == pytest.approx(np.array(lit), abs=1e-9)
    backwards = [rod.motion.pose(time_s) for time_s in times[::-1]]
    assert np.array_equal(poses, backwards[::-1]), "what was let go of is found again, bit for bit"


def test_a_camera_that_stands_turns_after_the_body_that_it_watches(tmp_path: Path) -> None:
    eye = '<camera pos="0 -3 9" mode="targetbody" target="ball"/>'
    world = load(tmp_path, FALL.replace("<worldbody>", f"<worldbody>{eye}"))
    (ball,) = world.instances
    for time_s in (0.0, 0.4, 1.0):
        eye_pose, place = world.camera.motion.pose(time_s), ball.motion.pose(time_s)[:3, 3]
        assert eye_pose[:3, 3] == pytest.approx((0, 9, 3))
        way = place - eye_pose[:3, 3]
        assert -eye_pose[:3, 2] == pytest.approx(way / np.linalg.norm(way), abs=1e-4)


def test_between_steps_things_go_straight(tmp_path: Path) -> None:
    rod = load(tmp_path, PENDULUM).instances[1].motion
    before, middle, after = (rod.pose(0.002 * step)[:3, 3] for step in (200, 200.5, 201))
    assert np.linalg.norm(after - before) > 1e-3
    assert middle == pytest.approx((before + after) / 2, abs=1e-5)


def test_where_nothing_moves_the_camera_circles(tmp_path: Path) -> None:
    world = load(tmp_path, PENDULUM.replace('axis="0 1 0"', 'axis="0 0 1"'))
    assert "nothing moves in robot: its camera circles" in world.notes[0]
    assert world.instances[1].motion.duration_s == 0


def test_physics_that_fails_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    stiff = FALL.replace("<mujoco>", '<mujoco><option timestep=".05" integrator="Euler"/>').replace(
        "<freejoint/>", '<joint type="slide" axis="0 0 1" stiffness="1e9"/>'
    )
    with pytest.raises(InputError, match=r"robot\.xml: its physics is unstable at 0\.\d+ s; expected a smaller"):
        load(tmp_path, stiff)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("<mujoco><worldbody><geom/></worldbody></mujoco>", r"robot\.xml: MuJoCo cannot load it \(.*size"),
        ("<mujoco><worldbody>", r"robot\.xml: MuJoCo cannot load it \("),
        ("<mujoco/>", "has no triangles"),
        ('<mujoco><worldbody><light dir="0 nan 1"/><geom size="1"/></worldbody></mujoco>', r"robot\.xml: .*not finite"),
    ],
)
def test_what_mujoco_refuses_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence) as refused:
        load(tmp_path, text)
    assert "\n" not in str(refused.value)


def test_what_mujocos_compiler_says_is_noted_and_refuses_nothing(tmp_path: Path) -> None:
    odd = FALL.replace("<mujoco>", '<mujoco><compiler settotalmass="3"/>')
    world = load_world(saved(tmp_path, odd), strict=True)
    assert not world.warnings and all(note.startswith("mujoco: ") for note in world.notes)


def test_colours_above_1_are_1(tmp_path: Path) -> None:
    """Models in use have them, written as if of 255."""
    (tmp_path / "m.xml").write_text(
        '<mujoco><worldbody><light pos="0 0 3"/><geom size=".1" rgba="22 0.5 -1 7"/></worldbody></mujoco>'
    )
    world = load_world(tmp_path / "m.xml")
    material = world.materials[world.meshes[0].material_ids[0]]
    assert material.color == pytest.approx((1.0, 0.214, 0.0), abs=1e-3) and material.opacity == 1


def test_no_parameters(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="models of MuJoCo's have no parameters"):
        load_world(f"{saved(tmp_path, FALL)}#a=1")


def test_without_mujoco(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"need mujoco; install it with: pip install 'clsim\[mujoco\]'"):
        load(tmp_path, FALL)


@pytest.mark.parametrize(
    ("data", "model"),
    [
        (b"\xef\xbb\xbf<?xml version='1.0'?>\n<!-- <scene> -->\n<mujoco model='a'>", True),
        ("<mujoco/>".encode("utf-16"), True),
        (b"<scene version='3.0.0'><mujoco/></scene>", False),
        (b"<!DOCTYPE mujoco SYSTEM 'a.dtd'><scene/>", False),
        (b"", False),
        (b"<<mujoco>", False),
        (b"<?xml version='1.0' encoding='none'?><mujoco/>", False),
    ],
)
def test_a_model_is_told_by_its_first_element(tmp_path: Path, data: bytes, model: bool) -> None:
    path = tmp_path / "a.xml"
    path.write_bytes(data)
    assert is_mjcf(path) is model


def test_before_its_start_all_is_where_it_starts(tmp_path: Path) -> None:
    """An exposure about the first frame begins before it."""
    (ball,) = load(tmp_path, FALL).instances
    np.testing.assert_array_equal(ball.motion.pose(-0.5), ball.motion.pose(0.0))


def test_names_that_others_have_already_get_a_sign_more(tmp_path: Path) -> None:
    """Of each two things one has a name, and the other would be called so after its number."""
    text = """<mujoco><worldbody><light name="light1" pos="0 0 3"/><light pos="1 0 3"/>
        <geom name="geom1" size=".1"/><geom size=".3" pos="1 0 0"/>
        <body><geom name="a/b" size=".1"/><geom name="a:b" size=".1" pos="1 0 0"/></body>
        <body name="body1"><geom size=".1"/></body><body name="light:light1"><geom size=".1"/></body>
        <body name="camera"><geom size=".1"/></body></worldbody></mujoco>"""
    world = load(tmp_path, text)
    model = mujoco.MjModel.from_xml_string(text)
    names = [each.name for each in (*world.instances, *world.punctual_lights)]
    assert len(world.instances) == model.ngeom and len(set(names)) == len(names) == model.ngeom + model.nlight
    (headlight,) = load(
        tmp_path, '<mujoco><worldbody><body name="headlight"><geom size=".1"/></body></worldbody></mujoco>'
    ).punctual_lights
    assert headlight.name == "headlight_"


@pytest.mark.parametrize(
    ("told", "size"), [("", (346, 260)), ('resolution="64 20"', (64, 20)), ('resolution="1 20"', (1, 20))]
)
def test_a_camera_has_the_pixels_that_the_model_tells(tmp_path: Path, told: str, size: tuple[int, int]) -> None:
    camera = load(tmp_path, f'<mujoco><worldbody><camera {told}/><geom size=".1"/></worldbody></mujoco>').camera
    assert (camera.width, camera.height) == size


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ('<site size=".1"/>', "sites"),
        ('<site size=".1" group="3"/>', None),
        ('<site size=".1" rgba="1 0 0 0"/>', None),
        ('<light type="image" texture="t"/>', "lights of pictures"),
        ('<geom size=".1" material="n"/>', "textures of other things than colours"),
    ],
)
def test_what_is_left_out_of_a_model_is_told(tmp_path: Path, body: str, what: str | None) -> None:
    assets = '<texture name="t" type="cube" builtin="flat" width="8" height="8"/>'
    if "material" in body:
        assets += '<material name="n"><layer role="normal" texture="t"/></material>'
    text = f'<mujoco><asset>{assets}</asset><worldbody>{body}<geom size=".1"/></worldbody></mujoco>'
    world = load(tmp_path, text)
    told = [f"mujoco: the model has {what}, which clsim leaves out"] if what else []
    assert list(world.warnings) == told


def test_a_height_field_is_as_solid_as_mujocos() -> None:
    """Rays from all around meet it where MuJoCo's do."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><asset><hfield name="h" nrow="3" ncol="4" size="1 2 .5 .3"
        elevation="0 .2 .1 .3 .5 .7 .2 .8 .9 .1 1 .4"/></asset>
        <worldbody><geom type="hfield" hfield="h"/></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mesh = mesh_of(model, 0)
    assert mesh is not None and mesh.normals is not None
    a, b, c = np.moveaxis(mesh.vertices.astype(float)[mesh.triangles], 1, 0)
    across, rng = np.cross(b - a, c - a), np.random.default_rng(3)
    for _ in range(60):
        away = rng.normal(size=3)
        start = 5 * away / np.linalg.norm(away)
        ray = rng.uniform((-0.8, -1.6, -0.2), (0.8, 1.6, 0.1)) - start
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.sum((a - start) * across, axis=1) / (across @ ray)
            at = start + t[:, None] * ray
            inside = [np.sum(np.cross(q - p, at - p) * across, axis=1) >= -1e-9 for p, q in ((a, b), (b, c), (c, a))]
        expected = mujoco.mj_ray(model, data, start, ray, None, 1, -1, np.zeros(1, np.int32))
        assert t[np.all(inside, axis=0) & (t > 0)].min() == pytest.approx(expected, abs=1e-4)
        front = np.argmin(np.where(np.all(inside, axis=0) & (t > 0), t, np.inf))
        assert across[front] @ ray < 0 and across[front] @ mesh.normals[mesh.triangles[front]].sum(axis=0) > 0
