"""Truth of small worlds in float64, by brute force: every pixel's centre against every triangle and sphere light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clsim.render.motion.deform import shaped
from clsim.scene import Camera, World


@dataclass
class Seen:
    """What rays meet: distance, owner (0 nothing, then instances, then sphere lights), and where on it."""

    distance: np.ndarray
    owner: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray
    points: np.ndarray
    normals: np.ndarray


def _triangles(world: World, time_s: float):
    """Corners ``[n, 3, 3]`` and instance of each triangle, and its number within the instance."""
    corners, owners, numbers = [], [], []
    for i, instance in enumerate(world.instances):
        mesh, pose = shaped(world.meshes[instance.mesh], time_s), instance.motion.pose(time_s)
        vertices = mesh.vertices.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
        corners.append(vertices[mesh.triangles])
        owners.append(np.full(len(mesh.triangles), i))
        numbers.append(np.arange(len(mesh.triangles)))
    return np.concatenate(corners), np.concatenate(owners), np.concatenate(numbers)


def pixel_centres(camera: Camera):
    y, x = np.meshgrid(np.arange(camera.height) + 0.5, np.arange(camera.width) + 0.5, indexing="ij")
    return np.stack([x, y], axis=-1).reshape(-1, 2)


def intrinsics(camera: Camera):
    """Focal length and centre [pixels], by their definition in docs/reference/scene-keys.md."""
    fov = np.radians(camera.fov_deg)
    fisheye = camera.lens.model == "fisheye"
    focal = camera.width / fov if fisheye else camera.width / (2 * np.tan(fov / 2))
    right, down = camera.lens.principal_point
    return focal, np.array([camera.width * (0.5 + right), camera.height / 2 + camera.width * down])


def project(camera: Camera, pose, points):
    """Image positions ``[n, 2]`` of points; NaN behind the camera. OpenCV's pinhole or fisheye model."""
    focal, centre = intrinsics(camera)
    local = (points - pose[:3, 3]) @ pose[:3, :3] * (1, -1, -1)
    k = (*camera.lens.distortion, *[0.0] * (5 - len(camera.lens.distortion)))
    if camera.lens.model == "fisheye":
        radius = np.linalg.norm(local[:, :2], axis=1)
        t = np.arctan2(radius, local[:, 2])
        scale = t * (1 + k[0] * t**2 + k[1] * t**4 + k[2] * t**6 + k[3] * t**8) / np.maximum(radius, 1e-300)
        return local[:, :2] * scale[:, None] * focal + centre
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (local[:, :2] / np.where(local[:, 2:] > 0, local[:, 2:], np.nan)).T
    r2 = x * x + y * y
    radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))
    across = x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x)
    down = y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y
    return np.stack([across, down], axis=1) * focal + centre


def centre_rays(camera: Camera, pose):
    """Unit directions ``[n, 3]`` through the pixels' centres of a lens without distortion."""
    focal, centre = intrinsics(camera)
    across, down = ((pixel_centres(camera) - centre) / focal).T
    if camera.lens.model == "fisheye":
        angle = np.hypot(across, down)
        scale = np.sin(angle) / np.maximum(angle, 1e-300)
        local = np.stack([across * scale, -down * scale, -np.cos(angle)], axis=1)
    else:
        local = np.stack([across, -down, -np.ones_like(across)], axis=1)
    world = local @ pose[:3, :3].T
    return world / np.linalg.norm(world, axis=1, keepdims=True)


def texture_at(world: World, texture: int, uv):
    """Linear values ``[..., 4]`` of an image without filter or encoding, which repeats: row 0 is at v = 1."""
    image = world.textures[texture]
    assert image.nearest and not image.srgb and (image.wrap_u, image.wrap_v) == ("repeat", "repeat")
    height, width = image.pixels.shape[:2]
    uv = np.nan_to_num(uv)
    column = np.minimum((uv[..., 0] % 1.0 * width).astype(int), width - 1)
    row = np.minimum(((1.0 - uv[..., 1] % 1.0) * height).astype(int), height - 1)
    return image.pixels[row, column] / 255.0


def _uv_of(mesh, triangle, weights):
    """Texture coordinates of a place on a triangle, by the weights of its corners."""
    return weights @ mesh.uvs[mesh.triangles[triangle]].astype(np.float64)


def _solid(world: World, owners, numbers, u, v):
    """Where rays would hit each triangle, whether its opacity there is at least one half ``[rays, triangles]``."""
    found = np.ones(u.shape, bool)
    for column, (owner, number) in enumerate(zip(owners, numbers, strict=True)):
        mesh = world.meshes[world.instances[owner].mesh]
        material = world.materials[mesh.material_ids[number]]
        if material.alpha_mode == "opaque":
            continue
        weights = np.stack([1 - u[:, column] - v[:, column], u[:, column], v[:, column]], axis=-1)
        opacity = material.opacity * np.ones(len(weights))
        if material.opacity_texture >= 0:
            opacity *= texture_at(world, material.opacity_texture, _uv_of(mesh, number, weights))[..., 3]
        found[:, column] = opacity >= (material.alpha_cutoff if material.alpha_mode == "mask" else 0.5)
    return found


def albedo_of(world: World, seen: Seen):
    """Reflectance of diffuse surfaces ``[n, 3]``; lamps and the sky have none."""
    found = np.zeros((len(seen.owner), 3))
    for i, instance in enumerate(world.instances):
        mesh = world.meshes[instance.mesh]
        for k in np.flatnonzero(seen.owner == i + 1):
            material = world.materials[mesh.material_ids[seen.triangle[k]]]
            found[k] = material.color
            if material.texture >= 0:
                uv = _uv_of(mesh, seen.triangle[k], seen.weights[k])
                found[k] *= texture_at(world, material.texture, uv)[:3]
    return found


def trace(world: World, time_s: float, origin, directions) -> Seen:
    """The nearest hit of each ray (Möller–Trumbore, JGT 1997)."""
    corners, owners, numbers = _triangles(world, time_s)
    a = corners[:, 0]
    e1, e2 = corners[:, 1] - a, corners[:, 2] - a
    p = np.cross(directions[:, None], e2[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / (p * e1).sum(-1)
        from_a = origin - a
        u = (p * from_a).sum(-1) * scale
        q = np.cross(from_a, e1)
        v = (directions[:, None] * q[None]).sum(-1) * scale
        t = (q * e2).sum(-1)[None] * scale
        good = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9)
        good &= _solid(world, owners, numbers, u, v)
    t = np.where(good, t, np.inf)
    best = t.argmin(axis=1)
    rows = np.arange(len(directions))
    distance = t[rows, best]
    hit = np.isfinite(distance)
    owner = np.where(hit, owners[best] + 1, 0)
    weights = np.stack([1 - u - v, u, v], axis=-1)[rows, best]
    normals = np.cross(e1, e2)[best]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for i, light in enumerate(world.sphere_lights):
        centre = light.motion.pose(time_s)[:3, 3]
        along = directions @ (centre - origin)
        gap2 = light.radius_m**2 - ((centre - origin - along[:, None] * directions) ** 2).sum(1)
        near = along - np.sqrt(np.maximum(gap2, 0))
        closer = (gap2 > 0) & (near > 0) & (near < distance)
        distance = np.where(closer, near, distance)
        owner = np.where(closer, 1 + len(world.instances) + i, owner)
        away = origin + near[:, None] * directions - centre
        normals = np.where(closer[:, None], away / light.radius_m, normals)
    with np.errstate(invalid="ignore"):
        points = origin + directions * distance[:, None]
    normals = np.where((normals * directions).sum(1, keepdims=True) > 0, -normals, normals)
    return Seen(distance, owner, numbers[best], weights, points, normals)


def carried(world: World, seen: Seen, time_s: float, other_s: float):
    """Where the points that were seen at one time are at another ``[n, 3]``; the sky's stay where they are."""
    points = seen.points.copy()
    for i, instance in enumerate(world.instances):
        mine = seen.owner == i + 1
        mesh, pose = shaped(world.meshes[instance.mesh], other_s), instance.motion.pose(other_s)
        corners = mesh.vertices.astype(np.float64)[mesh.triangles[seen.triangle[mine]]]
        local = (seen.weights[mine][:, :, None] * corners).sum(1)
        points[mine] = local @ pose[:3, :3].T + pose[:3, 3]
    for i, light in enumerate(world.sphere_lights):
        mine = seen.owner == 1 + len(world.instances) + i
        points[mine] += light.motion.pose(other_s)[:3, 3] - light.motion.pose(time_s)[:3, 3]
    return points


def truth(world: World, camera: Camera, time_s: float, other_s: float) -> dict[str, np.ndarray]:
    """All planes by name, as images; ``margin`` is by how much of the way covisible was decided."""
    size = camera.height, camera.width
    now, then = camera.motion.pose(time_s), camera.motion.pose(other_s)
    directions = centre_rays(camera, now)
    seen = trace(world, time_s, now[:3, 3], directions)
    sky = seen.owner == 0
    points = carried(world, seen, time_s, other_s)
    points[sky] = then[:3, 3] + directions[sky]
    ends = project(camera, then, points)
    ways = points - then[:3, 3]
    lengths = np.where(sky, np.inf, np.linalg.norm(ways, axis=1))
    blocked = trace(world, other_s, then[:3, 3], ways / np.linalg.norm(ways, axis=1, keepdims=True))
    inside = ((ends >= 0) & (ends < (camera.width, camera.height))).all(axis=1)
    with np.errstate(invalid="ignore"):
        margin = np.where(sky, np.where(blocked.owner == 0, 0.0, 1.0), 1 - blocked.distance / lengths)
    return {
        "owner": seen.owner.reshape(size),
        "distance": seen.distance.reshape(size),
        "depth": (seen.distance * (directions @ -now[:3, 2])).reshape(size),
        "albedo": albedo_of(world, seen).reshape(*size, 3),
        "normal": np.where(sky[:, None], 0, seen.normals).reshape(*size, 3),
        "flow": (ends - pixel_centres(camera)).reshape(*size, 2),
        "inside": inside.reshape(size),
        "margin": margin.reshape(size),
    }
