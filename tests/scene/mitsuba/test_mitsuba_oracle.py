"""Mitsuba scenes as Mitsuba 3 itself reads them: rays, hits, lights and environment."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from clsim.scene import load_world
from clsim.scene.light.spectra import GLASSES, METALS

pytestmark = pytest.mark.oracle
mi = pytest.importorskip("mitsuba", reason="needs the [oracle] extra")
ROOM = Path(__file__).resolve().parents[4] / "shared" / "assets" / "mitsuba" / "living-room"
FILM = '<film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="{}"/></film>'
POSE = '<transform name="to_world"><rotate x="0.6" y="0.8" angle="33"/><translate x="1" y="-2" z="3"/></transform>'

SIGNS = [" ".join(f'{axis}="{sign}"' for axis, sign in zip("xyz", s, strict=True)) for s in product((1, -1), repeat=3)]
MIRRORED = '<transform name="to_world"><scale {}/><rotate x="0.6" y="0.8" angle="33"/></transform>'
ACROSS = '<transform name="to_world"><rotate z="1" angle="20"/><scale {}/><rotate y="1" angle="50"/></transform>'
STRETCH = '<transform name="to_world"><scale x="-1.5" y="2" z="0.5"/></transform>'
ROUND = ("sphere", "disk", "cylinder", "slanted")
KINDS = ["rectangle", "cube", "sphere", "disk", "cylinder", "slanted", "obj", "ply", "obj-flat", "flipped"]


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def both(tmp_path, body):
    """Return our world and Mitsuba's scene of the same text."""
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{body}<shape type="cube"/></scene>')
    return load_world(path), mi.load_file(str(path))


@pytest.mark.parametrize("signs", SIGNS)
@pytest.mark.parametrize("place", [MIRRORED, ACROSS])
@pytest.mark.parametrize("size", [(60, 40)])
def test_mirrored_cameras_send_the_same_rays(tmp_path, size, place, signs):
    offset = '<float name="principal_point_offset_x" value="0.1"/><float name="fov" value="50"/>'
    body = f'<sensor type="perspective">{offset}{place.format(signs)}{FILM.format(*size)}</sensor>'
    world, scene = both(tmp_path, body)
    for x, y in ((0.5, 0.5), (0.1, 0.2), (0.9, 0.3), (0.3, 0.95)):
        ray, _ = scene.sensors()[0].sample_ray(0, 0.5, [x, y], [0.5, 0.5])
        np.testing.assert_allclose(our_ray(world.camera, x, y)[1], np.array(ray.d), atol=2e-6)


@pytest.mark.parametrize("signs", SIGNS)
def test_mirrored_lamps_shine_where_mitsubas_do(tmp_path, signs):
    place = ACROSS.format(signs)
    body = f'<emitter type="spot">{place}</emitter><emitter type="directional">{place}</emitter>'
    sheared = '<transform name="to_world"><matrix value="1 0.3 0.8 0 0 1 -0.4 0 0.2 0 -2 0 0 0 0 1"/></transform>'
    body += f'<emitter type="directional">{sheared}</emitter>'
    world, scene = both(tmp_path, body)
    si = mi.SurfaceInteraction3f()
    for light, emitter in zip(world.punctual_lights[1:], scene.emitters()[1:], strict=True):
        record, _ = emitter.sample_direction(si, [0.5, 0.5])
        # Where it stretches, Mitsuba's is no unit vector.
        np.testing.assert_allclose(light.motion.pose(0.0)[:3, 2], _unit(np.array(record.d)), atol=1e-6)
    axis = -world.punctual_lights[0].motion.pose(0.0)[:3, 2]
    for direction in (axis, -axis):
        si.p = mi.Point3f(2 * direction)
        _, value = scene.emitters()[0].sample_direction(si, [0.5, 0.5])
        assert (np.array(value).max() > 0) == (direction @ axis > 0)


def our_ray(camera, x, y):
    """Return the direction through a point of the film, x and y from 0 at the top left to 1."""
    pose, half = camera.motion.pose(0.0), np.tan(np.radians(camera.fov_deg) / 2)
    right, down = camera.lens.principal_point
    across = -1 if camera.lens.mirrored else 1
    up = -2 * half * ((y - 0.5) * camera.height / camera.width - down)
    d = pose[:3, :3] @ (across * 2 * half * (x - 0.5 - right), up, -1)
    return pose[:3, 3], d / np.linalg.norm(d)


@pytest.mark.parametrize("size", [(400, 200), (200, 300)])
@pytest.mark.parametrize(
    "sensor",
    [
        '<float name="fov" value="60"/>' + POSE,
        '<float name="fov" value="60"/><string name="fov_axis" value="y"/>',
        '<float name="fov" value="60"/><string name="fov_axis" value="smaller"/>' + POSE,
        '<float name="fov" value="60"/><string name="fov_axis" value="larger"/>',
        '<float name="fov" value="60"/><string name="fov_axis" value="diagonal"/>',
        '<string name="focal_length" value="35mm"/>',
        '<float name="fov" value="50"/><float name="principal_point_offset_x" value="0.1"/>'
        '<float name="principal_point_offset_y" value="-0.2"/>',
        '<float name="fov" value="40"/><transform name="to_world"><lookat origin="1,2,3" target="-4,0,2" up="0,1,0.2"/>'
        "</transform>",
        '<float name="fov" value="40"/><transform name="to_world"><lookat origin="1,2,3" target="-4,0,2"/></transform>',
    ],
)
def test_cameras_send_the_same_rays(tmp_path, size, sensor):
    world, scene = both(tmp_path, f'<sensor type="perspective">{sensor}{FILM.format(*size)}</sensor>')
    for x, y in ((0.5, 0.5), (0.1, 0.2), (0.9, 0.3), (0.3, 0.95)):
        ray, _ = scene.sensors()[0].sample_ray(0, 0.5, [x, y], [0.5, 0.5])
        _, direction = our_ray(world.camera, x, y)
        np.testing.assert_allclose(direction, np.array(ray.d), atol=2e-6)


@pytest.mark.parametrize("signs", SIGNS)
@pytest.mark.parametrize("place", [MIRRORED, ACROSS, STRETCH, ""])
@pytest.mark.parametrize("size", [(60, 40), (40, 60)])
def test_orthographic_cameras_send_the_same_rays(tmp_path, size, place, signs):
    body = f'<sensor type="orthographic">{place.format(signs)}{FILM.format(*size)}</sensor>'
    world, scene = both(tmp_path, body)
    camera = world.camera
    pose, (fx, fy) = camera.motion.pose(0.0), camera.focal_px()
    for x, y in ((0.5, 0.5), (0.1, 0.2), (0.9, 0.3), (0.3, 0.95)):
        ray, _ = scene.sensors()[0].sample_ray(0, 0.5, [x, y], [0.5, 0.5])
        np.testing.assert_allclose(-pose[:3, 2], _unit(np.array(ray.d)), atol=2e-6)
        start = pose[:3, :3] @ ((x - 0.5) * camera.width / fx, (0.5 - y) * camera.height / fy, 0) + pose[:3, 3]
        # Mitsuba's begins where its near plane is.
        off = np.array(ray.o) - start
        np.testing.assert_allclose(off - off @ pose[:3, 2] * pose[:3, 2], 0, atol=1e-5)


@pytest.mark.skipif(not ROOM.is_dir(), reason="the real scenes are not beside this checkout")
def test_the_camera_of_the_living_room():
    world, scene = load_world(ROOM / "scene_mi3.xml"), mi.load_file(str(ROOM / "scene_mi3.xml"))
    ray, _ = scene.sensors()[0].sample_ray(0, 0.5, [0.2, 0.7], [0.5, 0.5])
    origin, direction = our_ray(world.camera, 0.2, 0.7)
    np.testing.assert_allclose(direction, np.array(ray.d), atol=1e-5)
    np.testing.assert_allclose(origin, scene.sensors()[0].world_transform().translation(), atol=1e-5)
    assert len(scene.shapes()) == len(world.instances) or len(scene.shapes()) > 1  # Mitsuba may merge meshes
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for instance in world.instances:
        pose = instance.motion.pose(0.0)
        points = world.meshes[instance.mesh].vertices @ pose[:3, :3].T + pose[:3, 3]
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    np.testing.assert_allclose(low, np.array(scene.bbox().min), atol=1e-4)
    np.testing.assert_allclose(high, np.array(scene.bbox().max), atol=1e-4)


def first_hit(world, origin, direction):
    """Return point, uv (as Mitsuba has them) and normal of the nearest hit, by brute force."""
    best = (np.inf, None, None, None)
    for instance in world.instances:
        mesh, pose = world.meshes[instance.mesh], instance.motion.pose(0.0)
        points = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        for triangle in mesh.triangles:
            a, b, c = points[triangle]
            matrix = np.column_stack([b - a, c - a, -direction])
            if abs(np.linalg.det(matrix)) < 1e-12:
                continue
            u, v, t = np.linalg.solve(matrix, origin - a)
            if u >= -1e-9 and v >= -1e-9 and u + v <= 1 + 1e-9 and 1e-6 < t < best[0]:
                weights = np.array((1 - u - v, u, v))
                uv = weights @ mesh.uvs[triangle] if mesh.uvs is not None else np.zeros(2)
                normal = np.cross(b - a, c - a)
                if mesh.normals is not None:
                    normal = pose[:3, :3] @ (weights @ mesh.normals[triangle])
                best = (t, origin + t * direction, np.array((uv[0], 1 - uv[1])), normal / np.linalg.norm(normal))
    return best


@pytest.mark.parametrize("placed", ["", POSE, STRETCH])
@pytest.mark.parametrize("kind", KINDS)
def test_shapes_are_hit_where_mitsuba_hits_them(tmp_path, kind, placed):
    if placed == STRETCH and kind == "sphere":
        pytest.skip("Mitsuba's sphere cannot be stretched")
    vertices = np.random.default_rng(5).normal(size=(6, 3))
    faces = [(0, 1, 2), (1, 3, 2), (2, 3, 4), (0, 4, 5)]
    text = "".join("v {} {} {}\n".format(*v) for v in vertices) + "".join(
        f"vt {k / 6} {k * k / 36}\n" for k in range(6)
    )
    text += "".join("f " + " ".join(f"{k + 1}/{k + 1}" for k in face) + "\n" for face in faces)
    (tmp_path / "a.obj").write_text(text)
    header = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    header += "property float u\nproperty float v\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    rows = "".join("{} {} {} {} {}\n".format(*v, k / 6, k * k / 36) for k, v in enumerate(vertices))
    (tmp_path / "a.ply").write_text(header + rows + "".join("3 {} {} {}\n".format(*f) for f in faces))
    extra = {
        "obj": '<string name="filename" value="a.obj"/>',
        "obj-flat": '<string name="filename" value="a.obj"/><boolean name="face_normals" value="true"/>',
        "flipped": '<string name="filename" value="a.obj"/><boolean name="flip_normals" value="true"/>',
        "ply": '<string name="filename" value="a.ply"/>',
        "slanted": '<point name="p1" x="-1.3" y="-1.4" z="0.9"/>',
    }.get(kind, "")
    shape = {"obj-flat": "obj", "flipped": "obj", "slanted": "cylinder"}.get(kind, kind)
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0"><shape type="{shape}">{extra}{placed}</shape></scene>')
    world, scene = load_world(path), mi.load_file(str(path))
    bsphere = scene.bbox().bounding_sphere()
    rng, hits = np.random.default_rng(3), 0
    for _ in range(40):
        origin = np.array(bsphere.center) + 3 * float(bsphere.radius) * _unit(rng.normal(size=3))
        target = np.array(bsphere.center) + 0.6 * float(bsphere.radius) * rng.uniform(-1, 1, 3)
        direction = _unit(target - origin)
        theirs = scene.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
        t, point, uv, normal = first_hit(world, origin, direction)
        # What is round is divided into flat pieces here.
        coarse = 0.02 if kind in ROUND else 2e-4
        if theirs.is_valid() != np.isfinite(t):
            assert kind in ROUND  # at the silhouette
            continue
        if not theirs.is_valid() or abs(np.dot(np.array(theirs.n), direction)) < 0.2:
            continue
        hits += 1
        np.testing.assert_allclose(point, np.array(theirs.p), atol=coarse * 3 + 1e-4)
        np.testing.assert_allclose(normal, np.array(theirs.sh_frame.n), atol=0.12 if coarse > 0.01 else 1e-3)
        off = np.abs(uv - np.array(theirs.uv))
        assert (np.minimum(off, 1 - off) < coarse + 1e-3).all()
    assert hits >= 5


def _unit(v):
    return v / np.linalg.norm(v)


@pytest.mark.parametrize(
    "placed",
    [
        "",
        POSE,
        '<transform name="to_world"><rotate y="1" angle="90"/></transform>',
        *(place.format(signs) for place in (MIRRORED, ACROSS) for signs in SIGNS[1:]),
    ],
)
def test_environment_maps_lie_as_in_mitsuba(tmp_path, placed):
    """Each direction finds in the map, by its documented layout, what Mitsuba finds."""
    h, w = 64, 128
    row, column = np.meshgrid((np.arange(h) + 0.5) / h, (np.arange(w) + 0.5) / w, indexing="ij")
    pixels = np.stack([1 + np.cos(2 * np.pi * column), 1 + np.sin(2 * np.pi * column), row], axis=-1).astype(np.float32)
    mi.Bitmap(pixels).write(str(tmp_path / "a.exr"))
    image = '<string name="filename" value="a.exr"/><float name="scale" value="3"/>'
    light = f'<emitter type="envmap">{image}{placed}</emitter>'
    world, scene = both(tmp_path, light)
    environment = world.environment_map
    rng = np.random.default_rng(0)
    for _ in range(30):
        d = _unit(rng.normal(size=3))
        si = mi.SurfaceInteraction3f()
        si.wi = -mi.Vector3f(d)
        theirs = np.array(scene.environment().eval(si))
        x, y, z = environment.to_world.T @ d
        u, v = (np.arctan2(x, -z) / (2 * np.pi)) % 1, np.arccos(y) / np.pi  # from −z over +x; from +y down
        ours = environment.radiance[min(int(v * h), h - 1), int(u * w) % w]
        np.testing.assert_allclose(ours, theirs, atol=0.2)


def test_lights_shine_where_mitsuba_shines(tmp_path):
    body = f"""<emitter type="spot"><float name="cutoff_angle" value="30"/>{POSE}</emitter>
        <emitter type="directional"><vector name="direction" x="1" y="-2" z="0.5"/></emitter>
        <emitter type="directional">{POSE}</emitter>"""
    world, scene = both(tmp_path, body)
    spot, sun, turned = world.punctual_lights
    pose = spot.motion.pose(0.0)
    si = mi.SurfaceInteraction3f()
    for light, emitter in zip((sun, turned), scene.emitters()[1:], strict=True):
        record, _ = emitter.sample_direction(si, [0.5, 0.5])
        np.testing.assert_allclose(light.motion.pose(0.0)[:3, 2], np.array(record.d), atol=1e-6)
    for angle, lit in ((0, True), (20, True), (29, True), (31, False), (150, False)):
        local = (np.sin(np.radians(angle)), 0, -np.cos(np.radians(angle)))
        si.p = mi.Point3f(pose[:3, 3] + 2 * (pose[:3, :3] @ local))
        _, value = scene.emitters()[0].sample_direction(si, [0.5, 0.5])
        assert (np.array(value).max() > 0) == lit
        assert (angle < spot.outer_deg) == lit


@pytest.mark.parametrize("name", sorted(set(METALS) - {"CuZn"}))
def test_metals_are_those_of_mitsuba(name):
    parameters = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
    for key, ours in zip(("eta.value", "k.value"), METALS[name], strict=True):
        np.testing.assert_allclose(ours, np.array(parameters[key]).ravel(), atol=1e-4)


@pytest.mark.parametrize("name", sorted(GLASSES))
def test_glasses_are_those_of_mitsuba(name):
    """Inside and around: each name stands in both places."""
    for key in ("int_ior", "ext_ior"):
        glass = {"type": "dielectric", "int_ior": 1.0, "ext_ior": 1.0} | {key: name}
        theirs = float(mi.traverse(mi.load_dict(glass))["eta"])
        assert (theirs if key == "int_ior" else 1 / theirs) == pytest.approx(GLASSES[name], rel=1e-6)
