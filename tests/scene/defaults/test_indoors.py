"""The automatic camera: in closed rooms, and around everything else."""

from pathlib import Path

import numpy as np
import pytest

from clsim.scene import load_world
from clsim.scene.defaults.framing import ORBIT_S
from tests.scene.gltf.gltf_files import add, gltf, write_gltf

FACES = ["021", "123", "456", "576", "014", "154", "263", "367", "042", "246", "135", "375"]
SIDES = tuple(tuple(map(int, corners)) for corners in FACES)
"""Faces of a box, which look outwards."""


def box_of(size: tuple[float, float, float], inwards: bool) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float64) * size
    faces = np.array(SIDES)
    return corners, faces[:, ::-1] if inwards else faces


def write_obj(path: Path, *boxes: tuple[np.ndarray, np.ndarray]) -> Path:
    lines, first = [], 1
    for corners, faces in boxes:
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        lines += ["f " + " ".join(str(first + k) for k in face) for face in faces]
        first += len(corners)
    path.write_text("\n".join(lines))
    return path


def test_the_camera_stands_in_a_closed_room(tmp_path: Path) -> None:
    world = load_world(write_obj(tmp_path / "room.obj", box_of((6.0, 3.0, 4.0), inwards=True)))
    assert world.notes == ("room.obj: is a closed room: the camera stands in it",)
    motion, (lamp,) = world.camera.motion, world.sphere_lights
    assert motion.duration_s == ORBIT_S
    poses = np.array([motion.pose(t) for t in np.linspace(0, ORBIT_S, 25)])
    inside = (poses[:, :3, 3] > 0.3) & (poses[:, :3, 3] < (5.7, 2.7, 3.7))
    assert inside.all() and np.ptp(poses[:, :3, 3], axis=0)[[0, 2]].min() > 0.1
    np.testing.assert_allclose(poses[0], poses[-1], atol=1e-9)
    ahead = -poses[:, :3, 2]
    assert np.ptp(np.degrees(np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2])))) == pytest.approx(360.0)
    away = poses[:, :3, 3] - poses[:-1, :3, 3].mean(axis=0)
    assert (np.einsum("ij,ij->i", away, ahead) > 0).all(), "it looks out of its circle"
    place = lamp.motion.pose(0.0)[:3, 3]
    assert (place - lamp.radius_m > 0).all() and (place + lamp.radius_m < (6.0, 3.0, 4.0)).all()


def test_the_camera_stands_where_most_room_is(tmp_path: Path) -> None:
    """Of the places at shares of .3, .5, .7, and .4 or .6 of the height, the middle of a high room is 2 m from all."""
    world = load_world(write_obj(tmp_path / "hall.obj", box_of((6.0, 6.0, 4.0), inwards=True)))
    places = np.array([world.camera.motion.pose(t)[:3, 3] for t in np.linspace(0, ORBIT_S, 25)[:-1]])
    np.testing.assert_allclose(places.mean(axis=0), (3.0, 2.4, 2.0), atol=1e-6)


def test_solid_things_and_open_ones_are_seen_from_outside(tmp_path: Path) -> None:
    corners, faces = box_of((6.0, 3.0, 4.0), inwards=True)
    for name, boxes in (
        ("solid", [box_of((6.0, 3.0, 4.0), inwards=False)]),
        ("open", [(corners, faces[:-4])]),
        ("two", [box_of((1.0, 1.0, 1.0), inwards=False), (corners + np.array([9.0, 0.0, 0.0]), faces[:, ::-1])]),
    ):
        world = load_world(write_obj(tmp_path / f"{name}.obj", *boxes))
        eye = world.camera.motion.pose(0.0)[:3, 3]
        assert world.notes == () and np.abs(eye - (3.0, 1.5, 2.0)).max() > 4.0, name


def test_a_room_of_thick_walls_is_found_and_furniture_kept_clear_of(tmp_path: Path) -> None:
    """Outside the walls look outwards; a pillar stands in the middle of the room."""
    outer, inner = box_of((7.0, 4.0, 5.0), inwards=False), box_of((6.0, 3.0, 4.0), inwards=True)
    pillar = box_of((1.0, 3.0, 1.0), inwards=False)
    room = write_obj(tmp_path / "flat.obj", outer, (inner[0] + 0.5, inner[1]), (pillar[0] + (3.0, 0.5, 2.0), pillar[1]))
    world = load_world(room)
    assert world.notes == ("flat.obj: is a closed room: the camera stands in it",)
    for t in np.linspace(0, ORBIT_S, 9):
        x, y, z = world.camera.motion.pose(t)[:3, 3]
        assert 0.5 < x < 6.5 and 0.5 < y < 3.5 and 0.5 < z < 4.5
        assert not (3.0 <= x <= 4.0 and 2.0 <= z <= 3.0)


def lathe(profile: list[tuple[float, float]], corners: int) -> tuple[np.ndarray, np.ndarray]:
    """Return what turns a line of (radius, height) around y; its faces look to the right of its way."""
    turns = 2 * np.pi * np.arange(corners) / corners
    points = np.array([(r * np.cos(a), h, r * np.sin(a)) for r, h in profile for a in turns])
    faces = []
    for ring in range(len(profile) - 1):
        for k in range(corners):
            a, b = ring * corners + k, ring * corners + (k + 1) % corners
            faces += [(a, a + corners, b), (b, a + corners, b + corners)]
    return points, np.array(faces)


@pytest.mark.parametrize("corners", [9, 12, 15, 32])
@pytest.mark.parametrize(
    "profile",
    [
        [(0, 0), (1, 0), (1, 3), (0.4, 5), (0, 5), (0, 4.9), (0.3, 4.9), (0.9, 2.9), (0.9, 0.1), (0, 0.1)],
        [(0, 0), (1, 0), (1, 12), (0, 12), (0, 11.8), (0.8, 11.8), (0.8, 0.2), (0, 0.2)],
        [
            *((np.sin(a), -np.cos(a)) for a in np.linspace(0, np.pi, 9)),
            *((0.8 * np.sin(a), 0.8 * np.cos(a)) for a in np.linspace(0, np.pi, 9)),
        ],
    ],
    ids=["bottle", "tube", "globe"],
)
def test_hollow_things_are_seen_from_outside(tmp_path: Path, profile: list[tuple[float, float]], corners: int) -> None:
    """From within they are closed, and show their fronts; they do so from without as well."""
    points, faces = lathe(profile, corners)
    world = load_world(write_obj(tmp_path / "thing.obj", (points, faces)))
    eye = world.camera.motion.pose(0.0)[:3, 3]
    assert world.notes == () and (np.abs(eye - points.mean(axis=0)) > np.ptp(points, axis=0)).any()


def test_a_small_hollow_in_a_thing_is_no_room(tmp_path: Path) -> None:
    """A lantern on a pole: a box of thick walls, which is a small part of what is there."""
    lamp = box_of((1.0, 1.0, 1.0), inwards=False), box_of((0.9, 0.9, 0.9), inwards=True)
    base = box_of((3.0, 0.2, 3.0), inwards=False)
    away = np.array([1.0, 0.8, 1.0])
    parts = [(lamp[0][0] + away, lamp[0][1]), (lamp[1][0] + away + 0.05, lamp[1][1]), base]
    world = load_world(write_obj(tmp_path / "lantern.obj", *parts))
    assert world.notes == ()


def test_a_furnished_room_of_thick_walls_is_entered(tmp_path: Path) -> None:
    """Wardrobe, table and bed stand at its walls and in its middle."""
    outer, inner = box_of((5.4, 2.9, 4.4), inwards=False), box_of((5.0, 2.5, 4.0), inwards=True)
    parts = [outer, (inner[0] + 0.2, inner[1])]
    for size, place in (
        ((0.6, 2.0, 2.0), (0.2, 0.2, 1)),
        ((1.6, 0.7, 0.8), (2, 0.2, 2)),
        ((1.4, 0.5, 2.0), (3.8, 0.2, 2.2)),
    ):
        corners, faces = box_of(size, inwards=False)
        parts.append((corners + place, faces))
    world = load_world(write_obj(tmp_path / "bedroom.obj", *parts))
    assert world.notes == ("bedroom.obj: is a closed room: the camera stands in it",)


def test_a_room_as_gltf(tmp_path: Path) -> None:
    corners, faces = box_of((6.0, 3.0, 4.0), inwards=True)
    tree = gltf(points=corners.astype("<f4"))
    tree["accessors"][0]["count"] = 8
    tree["bufferViews"][0]["byteLength"] = tree["buffers"][0]["byteLength"] = 96
    tree["meshes"][0]["primitives"][0]["indices"] = add(tree, faces.ravel(), "<u2")
    world = load_world(write_gltf(tmp_path, tree))
    eye = world.camera.motion.pose(0.0)[:3, 3]
    assert (eye > 0).all() and (eye < (6.0, 3.0, 4.0)).all()
    assert "scene.gltf: is a closed room: the camera stands in it" in world.notes
    assert (world.sphere_lights[0].motion.pose(0.0)[:3, 3] < (6.0, 3.0, 4.0)).all(), "and so does the lamp"


@pytest.mark.parametrize("thick", [False, True])
@pytest.mark.parametrize("side", range(4))
def test_the_camera_looks_into_a_room_that_is_open_to_one_side(tmp_path: Path, side: int, thick: bool) -> None:
    """Cornell's box: from all around, its other walls would be seen from behind."""
    corners, faces = box_of((5.5, 5.5, 5.6), inwards=True)
    normal = [(-1, 0), (1, 0), (0, -1), (0, 1)][side]
    ends = corners[faces].mean(axis=1)[:, [0, 2]] - corners.mean(axis=0)[[0, 2]]
    kept = faces[(ends @ normal) < 2.0]
    table = box_of((1.5, 1.5, 1.5), inwards=False)
    parts = [(corners, kept), (table[0] + (1.0, 0.0, 1.0), table[1])]
    if thick:
        grown = (corners - corners.mean(axis=0)) * 1.04 + corners.mean(axis=0)
        parts.append((grown, kept[:, ::-1]))
    world = load_world(write_obj(tmp_path / "cornell.obj", *parts))
    assert world.notes == ("cornell.obj: is a room: the camera looks in from its open side",)
    for t in np.linspace(0, ORBIT_S, 9):
        pose = world.camera.motion.pose(t)
        away = (pose[:3, 3] - (2.75, 2.75, 2.8))[[0, 2]]
        assert away @ normal > 5.0 and np.degrees(np.arccos(away @ normal / np.linalg.norm(away))) < 16
        assert -pose[[0, 2], 2] @ normal < -0.95
    # Straight before it, the whole opening is just seen, by the pinhole's own projection.
    camera, pose = world.camera, world.camera.motion.pose(0.0)
    x, y, z = ((corners - pose[:3, 3]) @ pose[:3, :3]).T
    limit = np.tan(np.radians(camera.fov_deg / 2)) * np.array((1.0, camera.height / camera.width))
    assert 0.9 < (np.abs(np.stack([x, y], axis=1)) / -z[:, None] / limit).max() < 1
    lamp = world.sphere_lights[0].motion.pose(0.0)[:3, 3]
    assert (lamp > 0).all() and (lamp < 5.5).all()


def test_a_van_is_no_room(tmp_path: Path) -> None:
    """Its load space is a box of flat walls, empty; from outside there is more to see."""
    outer, inner = box_of((4.0, 2.2, 2.0), inwards=False), box_of((3.8, 2.0, 1.8), inwards=True)
    parts = [outer, (inner[0] + 0.1, inner[1])]
    for size, place in (
        ((1.2, 1.4, 2.0), (4.0, 0.0, 0.0)),
        ((0.8, 0.8, 0.2), (0.4, -0.4, -0.2)),
        ((0.8, 0.8, 0.2), (3.0, -0.4, -0.2)),
        ((0.8, 0.8, 0.2), (0.4, -0.4, 2.0)),
        ((0.8, 0.8, 0.2), (3.0, -0.4, 2.0)),
        ((0.8, 0.3, 1.0), (3.0, 2.2, 0.5)),
        ((0.8, 0.3, 1.0), (1.0, 2.2, 0.5)),
    ):
        corners, faces = box_of(size, inwards=False)
        parts.append((corners + place, faces))
    world = load_world(write_obj(tmp_path / "van.obj", *parts))
    assert world.notes == ()
