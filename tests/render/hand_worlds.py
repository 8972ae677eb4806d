"""Small worlds made by hand, and renders of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import Camera, Instance, Material, Mesh, Static, World

IDENTITY = Static(np.eye(4))
GREY = Material(color=(0.5, 0.4, 0.3))


def translation(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def look_from(position, target, up=(0.0, 1.0, 0.0)):
    """Camera pose by plain vector algebra."""
    back = np.subtract(position, target).astype(float)
    back /= np.linalg.norm(back)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([right, np.cross(back, right), back])
    matrix[:3, 3] = position
    return matrix


def camera(pose=None, width=16, height=16, fov_deg=40.0):
    return Camera(width, height, fov_deg, Static(np.eye(4) if pose is None else pose))


def quad(corner, edge_u, edge_v, material=0):
    """A parallelogram whose front is on the side of edge_u × edge_v; uv follows the edges."""
    corner, u, v = (np.asarray(x, float) for x in (corner, edge_u, edge_v))
    return Mesh(
        np.array([corner, corner + u, corner + u + v, corner + v], np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.full(2, material, np.int32),
        uvs=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32),
    )


def box(low, high, material=0):
    """A box whose faces look outwards."""
    x0, y0, z0 = low
    x1, y1, z1 = high
    x, y, z = (x1 - x0, 0, 0), (0, y1 - y0, 0), (0, 0, z1 - z0)
    sides = [
        quad((x0, y0, z0), z, y, material),
        quad((x1, y0, z0), y, z, material),
        quad((x0, y0, z0), x, z, material),
        quad((x0, y1, z0), z, x, material),
        quad((x0, y0, z0), y, x, material),
        quad((x0, y0, z1), x, y, material),
    ]
    return join(sides)


def join(meshes):
    firsts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.triangles + np.int32(first) for mesh, first in zip(meshes, firsts, strict=False)]),
        np.concatenate([mesh.material_ids for mesh in meshes]),
    )


def ball(radius, rings=16, material=0, smooth=False):
    """A sphere of triangles about the origin, inscribed."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij")
    unit = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij")
    a = (i * (2 * rings + 1) + j).ravel()
    b = a + 2 * rings + 1
    triangles = np.concatenate([np.stack([a, b, b + 1], -1), np.stack([a, b + 1, a + 1], -1)]).astype(np.int32)
    return Mesh(
        (unit * radius).astype(np.float32),
        triangles,
        np.full(len(triangles), material, np.int32),
        normals=unit.astype(np.float32) if smooth else None,
    )


def world(*meshes, materials=(GREY,), view=None, motions=None, **rest):
    """Each mesh placed once."""
    motions = motions or [IDENTITY] * len(meshes)
    return World(
        "test",
        view or camera(),
        meshes=tuple(meshes),
        instances=tuple(Instance(i, motion) for i, motion in enumerate(motions)),
        materials=tuple(materials),
        **rest,
    )


def render(scene, index=0, **options):
    """Render one frame with all planes."""
    tracer = PathTracer(scene, RenderOptions(**({"variances": True, "threads": 1} | options)))
    try:
        frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
        tracer.fill(index, frame)
        return frame
    finally:
        tracer.close()


def radiance(frame):
    return frame.planes[:3]


def mean_and_error(frame):
    """Mean radiance over the picture and its standard error, from the frame's own variances."""
    pixels = frame.width * frame.height
    variance = np.stack([frame.plane(f"Variance.{c}") for c in "RGB"]).sum(axis=(1, 2)) / pixels**2
    return radiance(frame).mean(axis=(1, 2)), np.sqrt(variance)


def with_camera(scene, view):
    return replace(scene, camera=view)
