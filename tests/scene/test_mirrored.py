"""Cameras and lamps under matrices that mirror, stretch and shear: they look and shine along the matrix's own axis."""

from itertools import count, product

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from clsim.scene import load_world
from clsim.scene.rigid import facing
from tests.scene.gltf.gltf_files import gltf, write_gltf
from tests.scene.mitsuba.mitsuba_files import load, scene
from tests.scene.usd.usd_files import METRES, mesh, usda

SIGNS = list(product((1, -1), repeat=3))
NUMBERS = count()
TURN = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]


def matrices():
    """All patterns of signs, with even and uneven scale, and sheared."""
    shear = np.array([[1, 0.4, -0.3], [0, 1, 0.6], [0.2, 0, 1]])
    for signs in SIGNS:
        for linear in (np.eye(3), np.diag((0.5, 2, 3)), shear):
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = TURN @ linear @ np.diag(signs), (1, 2, 3)
            yield matrix


def assert_faces(pose, matrix):
    """−z is the matrix's, y leans as the matrix's does, and the pose is a rotation."""
    turn, (_, up, back) = pose[:3, :3], matrix[:3, :3].T
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-6)
    assert np.linalg.det(turn) > 0
    np.testing.assert_allclose(turn[:, 2], back / np.linalg.norm(back), atol=1e-6)
    assert abs(turn[:, 0] @ up) < 1e-6 * np.linalg.norm(up) and turn[:, 1] @ up > 0
    np.testing.assert_allclose(pose[:3, 3], matrix[:3, 3], atol=1e-6)


def test_gltf(tmp_path):
    for matrix in matrices():
        lamp = {"extensions": {"KHR_lights_punctual": {"light": 0}}}
        nodes = [{"mesh": 0}, {"matrix": matrix.T.ravel().tolist(), "children": [2, 3]}, {"camera": 0}, lamp]
        lights = {"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {}}]}}
        tree = gltf(nodes=nodes, scenes=[{"nodes": [0, 1]}], extensions=lights)
        tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
        world = load_world(write_gltf(tmp_path, tree))
        assert_faces(world.camera.motion.pose(0.0), matrix)
        assert_faces(world.punctual_lights[0].motion.pose(0.0), matrix)


ANY = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
TWO_LINEAR = arrays(np.float64, (2, 3, 3), elements=st.floats(-1e3, 1e3))
"""Those of a node and of one within it."""


def assert_looks_along(pose, back):
    """The pose is a rotation, and its z axis leads where a finite matrix's column does."""
    turn = pose[:3, :3]
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) > 0
    if np.abs(back).max() > 1e-100:
        np.testing.assert_allclose(turn[:, 2], back / np.linalg.norm(back), atol=1e-9)


def test_axes_that_are_nearly_one_still_make_a_rotation():
    for tilt in (1e-6, 1e-8, 1e-10, 1e-11):
        pose = facing(whole([[1.0, 0.6, 0.6 + tilt], [0.3, 0.7, 0.7], [0.2, 0.4, 0.4]]))
        assert_looks_along(pose, np.array([0.6 + tilt, 0.7, 0.4]))


def whole(linear):
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    return matrix


@ANY
@given(TWO_LINEAR)
def test_any_matrices_of_nodes_lead_a_gltf_camera(tmp_path, linear):
    """A camera within a node within a node looks along the third column of the product."""
    nodes = [{"mesh": 0}]
    nodes += [{"matrix": whole(part).T.ravel().tolist(), "children": [k + 2]} for k, part in enumerate(linear)]
    tree = gltf(nodes=[*nodes, {"camera": 0}], scenes=[{"nodes": [0, 1]}])
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    pose = load_world(write_gltf(tmp_path, tree)).camera.motion.pose(0.0)
    assert_looks_along(pose, (linear[0] @ linear[1])[:, 2])


@ANY
@given(TWO_LINEAR)
def test_any_matrices_of_prims_lead_a_usd_camera_and_a_sun(tmp_path, linear):
    """So it is in USD, whose matrices are written as rows, and of what shines along −z."""
    pytest.importorskip("pxr", reason="needs the usd extra")
    places = []
    for part in linear:
        rows = ", ".join("(" + ", ".join(map(repr, row)) + ")" for row in whole(part).T.tolist())
        places.append(f'matrix4d xformOp:transform = ({rows})\nuniform token[] xformOpOrder = ["xformOp:transform"]\n')
    sun = 'def DistantLight "sun"\n{\nfloat inputs:angle = 0\n' + places[1] + "}\n"
    eye = 'def Camera "eye"\n{\n' + places[1] + "}\n"
    body = mesh() + 'def Xform "root"\n{\n' + places[0] + eye + sun + "}\n"
    # USD keeps files that are open, by their names.
    world = load_world(usda(tmp_path, body, METRES, f"{next(NUMBERS)}.usda"))
    back = (linear[0] @ linear[1])[:, 2]
    assert_looks_along(world.camera.motion.pose(0.0), back)
    assert_looks_along(world.punctual_lights[0].motion.pose(0.0), back)


@ANY
@given(TWO_LINEAR)
def test_any_steps_of_a_transform_lead_a_mitsuba_camera_and_a_spot(tmp_path, linear):
    """Mitsuba looks along +z, and of a transform's steps the first is applied first."""
    steps = "".join(f'<matrix value="{" ".join(map(repr, whole(part).ravel().tolist()))}"/>' for part in linear)
    place = f'<transform name="to_world">{steps}</transform>'
    body = f'<sensor type="perspective">{place}</sensor><emitter type="spot">{place}</emitter><shape type="cube"/>'
    world = load_world(scene(tmp_path, body))
    back = -(linear[1] @ linear[0])[:, 2]
    assert_looks_along(world.camera.motion.pose(0.0), back)
    assert_looks_along(world.punctual_lights[0].motion.pose(0.0), back)


def test_gltf_cameras_that_pan_under_a_mirror(tmp_path):
    """A turn of 90° in 30 steps: none is larger than its share."""
    from tests.scene.gltf.gltf_files import add

    tree = gltf(nodes=[{"mesh": 0}, {"scale": [-1, 1, 1], "children": [2]}, {"camera": 0}], scenes=[{"nodes": [0, 1]}])
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    times, turns = add(tree, [0, 1]), add(tree, [(0, 0, 0, 1), (0, np.sqrt(0.5), 0, np.sqrt(0.5))])
    samplers = [{"input": times, "output": turns}]
    channels = [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}]
    tree["animations"] = [{"samplers": samplers, "channels": channels}]
    motion = load_world(write_gltf(tmp_path, tree)).camera.motion
    ahead = np.array([-motion.pose(t)[:3, 2] for t in np.linspace(0, 1, 31)])
    np.testing.assert_allclose(np.degrees(np.arccos((ahead[1:] * ahead[:-1]).sum(axis=1).clip(-1, 1))), 3, atol=0.01)
    np.testing.assert_allclose(ahead[-1], (1, 0, 0), atol=1e-6)  # without the mirror it would be −x


def test_usd(tmp_path):
    """Against USD's own frustum of the camera, which is what usdview shows."""
    pxr = pytest.importorskip("pxr", reason="needs the usd extra")
    from pxr import Usd, UsdGeom

    assert pxr
    for number, matrix in enumerate(matrices()):
        rows = ", ".join("(" + ", ".join(map(repr, row)) + ")" for row in matrix.T.tolist())
        place = f'matrix4d xformOp:transform = ({rows})\nuniform token[] xformOpOrder = ["xformOp:transform"]\n'
        body = mesh() + f'def Xform "root"\n{{\n{place}\ndef Camera "eye"\n{{\n}}\n'
        body += 'def DistantLight "sun"\n{\nfloat inputs:angle = 0\n}\n}\n'
        path = usda(tmp_path, body, METRES, f"{number}.usda")  # USD keeps files that are open
        world = load_world(path)
        pose = world.camera.motion.pose(0.0)
        assert_faces(pose, matrix)
        assert_faces(world.punctual_lights[0].motion.pose(0.0), matrix)
        gram = matrix[:3, :3].T @ matrix[:3, :3]
        if np.allclose(gram, np.diag(np.diag(gram))):  # what is sheared, USD makes square in a way of its own
            stage = Usd.Stage.Open(str(path))
            frustum = UsdGeom.Camera(stage.GetPrimAtPath("/root/eye")).GetCamera(0).frustum
            np.testing.assert_allclose(-pose[:3, 2], frustum.ComputeViewDirection(), atol=1e-6)
            np.testing.assert_allclose(pose[:3, 1], frustum.ComputeUpVector(), atol=1e-6)


def test_mitsuba_shapes_that_move_keep_their_mirror(tmp_path):
    """An animated transform with a mirror: corners go where the matrices lead them."""
    first = '<scale x="-2" y="1" z="1"/><rotate y="1" angle="{}"/><translate x="{}"/>'
    keys = "".join(f'<transform time="{t}">{first.format(40 * t, 3 * t)}</transform>' for t in (0, 1))
    body = f'<shape type="cube"><animation name="to_world">{keys}</animation></shape>'
    world = load(tmp_path, body, "0.6.0")
    instance = world.instances[0]
    corners = world.meshes[instance.mesh].vertices
    for t in (0, 1):
        c, s = np.cos(np.radians(40 * t)), np.sin(np.radians(40 * t))
        matrix = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.diag((-2, 1, 1))
        cube = np.array(list(product((-1, 1), repeat=3))) @ matrix.T + (3 * t, 0, 0)
        pose = instance.motion.pose(float(t))
        ours = np.unique((corners @ pose[:3, :3].T + pose[:3, 3]).round(4), axis=0)
        np.testing.assert_allclose(ours, np.unique(cube.round(4), axis=0), atol=1e-3)
