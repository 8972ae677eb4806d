"""The 16-wide tree, and the list that stands in for a small one.

Against brute force in float64, Warp's own tree, and geometry that has no other answer.
"""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from clsim.render.accel.bvh16 import Bvh16
from clsim.render.accel.bvh16_traverse import MAX_DEPTH, any_in_tree, any_opaque_in_tree, closest_in_tree
from clsim.render.device.devices import start_warp
from tests.render import hand_worlds as hw

FAR = 1e30


@wp.kernel(enable_backward=False, module="test_bvh16")
def search(
    tree: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    near: wp.array(dtype=float),
    far: wp.array(dtype=float),
    out_triangle: wp.array(dtype=int),
    out_weights: wp.array(dtype=wp.vec3),
    out_any: wp.array(dtype=int),
    out_corners: wp.array2d(dtype=float),
):
    i = wp.tid()
    hit = closest_in_tree(tree, origins[i], directions[i], near[i], far[i])
    out_triangle[i] = hit[0]
    out_weights[i] = wp.vec3(wp.cast(hit[1], float), wp.cast(hit[2], float), wp.cast(hit[3], float))
    out_any[i] = int(any_in_tree(tree, origins[i], directions[i], near[i], far[i]))
    for k in range(12):
        out_corners[i, k] = wp.cast(hit[4 + k], float)


@wp.kernel(enable_backward=False, module="test_bvh16")
def search_opaque(
    tree: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    far: float,
    out_found: wp.array(dtype=int),
):
    i = wp.tid()
    out_found[i] = any_opaque_in_tree(tree, origins[i], directions[i], 0.0, far)


@wp.kernel(enable_backward=False, module="test_bvh16")
def search_warp(
    tree: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    out_triangle: wp.array(dtype=int),
    out_weights: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    hit = wp.mesh_query_ray(tree, origins[i], directions[i], 1.0e30)
    out_triangle[i] = wp.where(hit.result, hit.face, -1)
    out_weights[i] = wp.vec3(hit.t, hit.u, hit.v)


def arrays(vertices, triangles):
    start_warp()
    return (
        wp.array(np.asarray(vertices, np.float32).reshape(-1, 3), dtype=wp.vec3, device="cpu"),
        wp.array(np.asarray(triangles, np.int32).ravel(), dtype=wp.int32, device="cpu"),
    )


def build(mesh):
    return Bvh16(*arrays(mesh.vertices, mesh.triangles))


def shoot(tree, origins, directions, near=0.0, far=FAR, corners=None):
    """Triangle, t and weights of the nearest hits, and whether there is any; checks corners and normals if told."""
    origins, directions = np.broadcast_arrays(np.asarray(origins, np.float32), np.asarray(directions, np.float32))
    n = len(origins)
    rays = [wp.array(np.ascontiguousarray(a), dtype=wp.vec3, device="cpu") for a in (origins, directions)]
    limits = [
        wp.array(np.broadcast_to(np.asarray(a, np.float32), n).copy(), dtype=float, device="cpu") for a in (near, far)
    ]
    triangle, found = (wp.zeros(n, dtype=int, device="cpu") for _ in range(2))
    weights = wp.zeros(n, dtype=wp.vec3, device="cpu")
    vertices_and_normal = wp.zeros((n, 12), dtype=float, device="cpu")
    outputs = [triangle, weights, found, vertices_and_normal]
    wp.launch(search, dim=n, inputs=[wp.uint64(tree.id), *rays, *limits], outputs=outputs, device="cpu")
    if corners is not None:
        hit = triangle.numpy() >= 0
        expected, told = corners[triangle.numpy()[hit]], vertices_and_normal.numpy()[hit]
        np.testing.assert_array_equal(told[:, :9].reshape(-1, 3, 3), expected)
        normal = np.cross(expected[:, 1] - expected[:, 0], expected[:, 2] - expected[:, 0]).astype(np.float64)
        np.testing.assert_allclose(told[:, 9:], normal / np.linalg.norm(normal, axis=1, keepdims=True), atol=1e-4)
    return triangle.numpy(), weights.numpy()[:, 0], weights.numpy()[:, 1:], found.numpy() != 0


def brute_force(vertices, triangles, origins, directions):
    """All hits in float64 by Cramer's rule: t [rays, triangles], infinite on a miss, and the smallest weight."""
    a, b, c = (np.asarray(vertices, np.float64)[np.asarray(triangles)[:, i]] for i in range(3))
    o, d = (np.asarray(x, np.float32).astype(np.float64)[:, None] for x in (origins, directions))
    normal = np.cross(b - a, c - a)
    with np.errstate(all="ignore"):
        det = -(d @ normal.T)[:, 0]
        s = o - a
        turned = np.cross(s, d)
        v1 = np.einsum("rti,ti->rt", turned, c - a) / det
        v2 = -np.einsum("rti,ti->rt", turned, b - a) / det
        t = np.einsum("rti,ti->rt", s, normal) / det
    weights = np.stack([1 - v1 - v2, v1, v2], axis=-1)
    margin = np.where(np.isfinite(det) & (det != 0), weights.min(axis=-1), -np.inf)
    return np.where((margin >= 0) & (t >= 0), t, np.inf), weights, margin


def directions(rng, n):
    d = rng.normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def soup(rng, n, size=0.3):
    corners = rng.uniform(-1, 1, (n, 1, 3)) + rng.normal(scale=size, size=(n, 3, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * n, dtype=np.int32).reshape(n, 3)


@pytest.mark.parametrize("triangles", [1, 7, 8, 9, 64, 65, 700])
def test_nearest_hits_are_those_of_brute_force(triangles):
    rng = np.random.default_rng(triangles)
    vertices, indices = soup(rng, triangles)
    origins = rng.uniform(-1.5, 1.5, (2000, 3)).astype(np.float32)
    aims = vertices[indices[rng.integers(triangles, size=2000)]].mean(axis=1) + rng.normal(scale=0.3, size=(2000, 3))
    toward = aims - origins
    triangle, t, weights, found = shoot(Bvh16(*arrays(vertices, indices)), origins, toward, corners=vertices[indices])
    true_t, true_weights, margin = brute_force(vertices, indices, origins, toward)
    # Rays within rounding of an edge, or that meet two triangles at one place, have no certain answer.
    clear = (np.abs(margin) > 1e-4).all(axis=1)
    true_triangle = np.where(np.isfinite(true_t).any(axis=1), true_t.argmin(axis=1), -1)
    assert clear.mean() > 0.8 or triangles == 700
    assert 0.005 < (true_triangle >= 0).mean() < 0.99
    np.testing.assert_array_equal(triangle[clear], true_triangle[clear])
    np.testing.assert_array_equal(found, triangle >= 0)
    hit = clear & (triangle >= 0)
    np.testing.assert_allclose(t[hit], true_t.min(axis=1)[hit], rtol=1e-3, atol=1e-5)
    expected = true_weights[np.flatnonzero(hit), triangle[hit]]
    assert np.median(np.abs(weights[hit] - expected[:, :2]).max(axis=1)) < 1e-5


@pytest.mark.parametrize("triangles", [1, 9, 64, 65, 700])
def test_what_may_let_a_ray_pass_does_not_hide_what_stops_it(triangles):
    rng = np.random.default_rng(triangles)
    vertices, indices = soup(rng, triangles)
    may_pass = rng.random(triangles) < 0.7
    tree = Bvh16(*arrays(vertices, indices), may_pass=may_pass)
    origins = rng.uniform(-1.5, 1.5, (1000, 3)).astype(np.float32)
    aims = vertices[indices[rng.integers(triangles, size=1000)]].mean(axis=1)
    toward = (aims - origins).astype(np.float32)
    rays = [wp.array(a, dtype=wp.vec3, device="cpu") for a in (origins, toward)]
    found = wp.zeros(len(origins), dtype=int, device="cpu")
    wp.launch(search_opaque, len(origins), inputs=[wp.uint64(tree.id), *rays, 1.5], outputs=[found], device="cpu")
    true_t, _, margin = brute_force(vertices, indices, origins, toward)
    met = true_t <= 1.5
    expected = np.where(met[:, ~may_pass].any(axis=1), 1, np.where(met.any(axis=1), 2, 0))
    clear = ((np.abs(margin) > 1e-4) & (np.abs(true_t - 1.5) > 1e-4)).all(axis=1)
    assert triangles == 1 or min(np.count_nonzero(expected[clear] == each) for each in (1, 2)) > 3
    np.testing.assert_array_equal(found.numpy()[clear], expected[clear])


def test_warps_tree_finds_the_same():
    rng = np.random.default_rng(1)
    mesh = hw.ball(1.0, rings=100)
    bumps = 1 + 0.05 * np.sin(9 * mesh.vertices).sum(axis=1, keepdims=True)
    vertices, indices = arrays(mesh.vertices * bumps, mesh.triangles)
    origins = (directions(rng, 40_000) * rng.choice([0.3, 0.9, 2.0], (40_000, 1))).astype(np.float32)
    toward = directions(rng, 40_000)
    triangle, t, weights, _ = shoot(Bvh16(vertices, indices), origins, toward)
    theirs = wp.Mesh(vertices, indices)
    rays = [wp.array(a.astype(np.float32), dtype=wp.vec3, device="cpu") for a in (origins, toward)]
    their_triangle = wp.zeros(len(origins), dtype=int, device="cpu")
    their_weights = wp.zeros(len(origins), dtype=wp.vec3, device="cpu")
    outputs = [their_triangle, their_weights]
    wp.launch(search_warp, dim=len(origins), inputs=[theirs.id, *rays], outputs=outputs, device="cpu")
    same = their_triangle.numpy() == triangle
    assert 0.4 < (triangle >= 0).mean() < 0.95
    assert ((their_triangle.numpy() >= 0) != (triangle >= 0)).mean() <= 1e-4 and same.mean() >= 0.9995
    hit = same & (triangle >= 0)
    np.testing.assert_allclose(t[hit], their_weights.numpy()[hit, 0], rtol=1e-4, atol=2e-5)
    assert np.median(np.abs(weights - their_weights.numpy()[:, 1:])[hit]) < 1e-5


@pytest.mark.parametrize("rings", [4, 40])
@pytest.mark.parametrize(("centre", "stretch"), [((0, 0, 0), (1, 1, 1)), ((40, -3, 7), (1, 1e-3, 30))])
def test_no_ray_leaves_a_closed_surface(centre, stretch, rings):
    rng = np.random.default_rng(2)
    mesh = hw.ball(1.0, rings)
    vertices = (mesh.vertices * np.asarray(stretch) + np.asarray(centre)).astype(np.float32)
    # The ends of the meridians meet in one vertex each, so that the surface is closed to the last bit.
    rows = vertices.reshape(rings + 1, 2 * rings + 1, 3)
    rows[:, -1] = rows[:, 0]
    rows[0], rows[-1] = rows[0, 0], rows[-1, 0]
    tree = Bvh16(*arrays(vertices, mesh.triangles))
    assert (tree.levels == 0) == (rings == 4)
    depth = 0.98 if rings == 40 else 0.6
    inside = (directions(rng, 500_000) * rng.random((500_000, 1)) ** 2 * depth * stretch + centre).astype(np.float32)
    corners = vertices[mesh.triangles[rng.integers(len(mesh.triangles), size=500_000)]].astype(np.float64)
    weight = rng.integers(0, 5, (500_000, 1)) / 4
    at_edge = corners[:, 0] * weight + corners[:, 1] * (1 - weight)
    for toward in (directions(rng, 500_000), at_edge - inside):
        triangle, t, _, found = shoot(tree, inside, toward)
        assert np.all(t < 100)
        # Of rays right at a vertex, a list may let some pass; a tree none.
        sure = (weight[:, 0] % 1 != 0) | (rings == 40)
        assert np.all(triangle[sure] >= 0) and np.all(found[sure])
        assert np.mean(triangle < 0) < 1e-3 and np.mean(~found) < 1e-3


def test_rays_along_axes_and_in_the_planes_of_boxes():
    """From grid points inside a box made of unit squares, through its edges and vertices, with zeros in directions."""
    mesh = hw.box((-2, -2, -2), (2, 2, 2))
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, -0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    steps = np.array([-1.0, -0.0, 0.0, 1.0])
    toward = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    toward = toward[np.any(toward != 0, axis=1)]
    o, d = np.repeat(grid, len(toward), axis=0), np.tile(toward, (len(grid), 1))
    triangle, t, _, found = shoot(build(mesh), o, d)
    assert np.all(triangle >= 0) and np.all(found)
    with np.errstate(divide="ignore"):
        walls = np.where(d != 0, (2 - np.sign(d) * o) / np.abs(d), np.inf).min(axis=1)
    np.testing.assert_allclose(t, walls, rtol=1e-6)
    # Along the wall itself, from inside its plane and from its border.
    triangle, t, _, found = shoot(build(mesh), [[0.5, 2, 0.3], [0, -2, -2]], [[0, 0, -2], [0.5, 0, 0]])
    np.testing.assert_allclose(t, [1.15, 4])
    assert np.all(found)


def test_the_range_of_t_includes_its_start_and_direction_length_is_its_unit():
    tree = build(hw.join([hw.quad((-1, -1, -z), (2, 0, 0), (0, 2, 0)) for z in (1, 2, 3)]))
    near = [0, 1, 1.0001, 2.5, 3.0001, 0, 0, 1.5]
    far = [9, 9, 9, 9, 9, 0.9999, 1.5, 1.9999]
    triangle, t, _, found = shoot(tree, np.tile([0.2, 0.3, 0], (8, 1)), [[0, 0, -1]], near, far)
    np.testing.assert_array_equal(np.where(triangle >= 0, t, 0), [1, 1, 2, 3, 0, 0, 1, 0])
    np.testing.assert_array_equal(found, triangle >= 0)
    _, t, _, _ = shoot(tree, [[0.2, 0.3, 0]] * 2, [[0, 0, -0.25], [0, 0, -1e6]])
    np.testing.assert_allclose(t, [4, 1e-6])


def broken(rng, vertices, triangles):
    """The triangles among ones that nothing may hit; returns the mesh and which are sound."""
    bad = np.array(
        [
            [[np.nan, 0, 0], [1, 0, 0], [0, 1, 0]],
            [[0, 0, 0], [np.inf, 0, 0], [0, 1, 0]],
            [[0, 0, 0], [1, 0, 0], [0, -np.inf, np.nan]],
            [[-3e38, -3e38, 0], [3e38, 0, 0], [0, 3e38, 0]],
            [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
            [[-1, -1, 0], [0, 0, 0], [1, 1, 0]],
            [[-1, -1, 0], [-1, -1, 0], [1, 1, 0]],
            [[-1, 0.1, 0.3], [1, 0.1, 0.3], [-1, 0.1, 0.3]],
        ],
        np.float32,
    )
    bad = np.tile(bad, (6, 1, 1))
    corners = np.concatenate([vertices[triangles], bad])
    mixed = rng.permutation(len(corners))
    return corners[mixed].reshape(-1, 3), np.arange(3 * len(mixed)).reshape(-1, 3), mixed < len(triangles)


@pytest.mark.parametrize("count", [40, 70])
def test_broken_triangles_are_never_hit_and_hide_nothing(count):
    rng = np.random.default_rng(3)
    vertices, triangles = soup(rng, count)
    mixed, indices, sound = broken(rng, vertices, triangles)
    origins = rng.uniform(-2, 2, (20_000, 3))
    # Some right at the flat ones.
    toward = np.where(np.arange(20_000)[:, None] % 2, -origins, rng.uniform(-1, 1, (20_000, 3)) - origins)
    triangle, t, _, found = shoot(Bvh16(*arrays(mixed, indices)), origins, toward)
    alone, alone_t, _, _ = shoot(Bvh16(*arrays(mixed, indices[sound])), origins, toward)
    np.testing.assert_array_equal(triangle, np.where(alone >= 0, np.flatnonzero(sound)[alone], -1))
    np.testing.assert_array_equal(t, alone_t)
    np.testing.assert_array_equal(found, alone >= 0)
    nothing = Bvh16(*arrays(mixed, indices[~sound]))
    triangle, _, _, found = shoot(nothing, origins, toward)
    assert np.all(triangle == -1) and not np.any(found)
    empty = Bvh16(*arrays(np.zeros((3, 3)), np.zeros((0, 3))))
    assert np.all(shoot(empty, origins[:9], toward[:9])[0] == -1)


@pytest.mark.parametrize("rings", [4, 16])
def test_rays_that_are_no_rays_end(rings):
    tree = build(hw.ball(1.0, rings))
    values = np.array([0.0, 1.0, -1e-38, 1e30, np.inf, -np.inf, np.nan], np.float32)
    toward = np.stack(np.meshgrid(values, values, values, indexing="ij"), axis=-1).reshape(-1, 3)
    for origin in ((0.1, 0.2, 0.3), (np.nan, 0, 0), (np.inf, 0, -np.inf), (1e38, -1e38, 0)):
        triangle, _, _, _ = shoot(tree, np.tile(origin, (len(toward), 1)), toward)
        assert triangle.min() >= -1 and triangle.max() < 4 * rings**2


def test_depth_is_bounded_whatever_the_mesh():
    """Scales that differ by powers of two fool the heuristic: it takes the largest off, one by one."""
    rng = np.random.default_rng(4)
    scales = np.repeat(np.exp2(np.arange(-24, 39, 1.0)), 40)[:, None, None]
    corners = (directions(rng, len(scales))[:, None] + 0.01 * rng.normal(size=(len(scales), 3, 3))) * scales
    corners = np.concatenate([corners, np.tile(corners[:1], (500, 1, 1))]).astype(np.float32)
    tree = Bvh16(*arrays(corners.reshape(-1, 3), np.arange(3 * len(corners))))
    assert 8 < tree.levels <= MAX_DEPTH
    toward = corners[: len(scales)].mean(axis=1) / scales[:, 0]
    triangle, _, _, found = shoot(tree, np.zeros_like(toward), toward)
    assert np.all(found) and np.all(triangle >= 0)
    same = Bvh16(*arrays(np.tile(corners[0], (5000, 1)), np.arange(15000)))
    assert same.levels <= 8
    assert shoot(same, [[0, 0, 0]], corners[:1].mean(axis=1))[0][0] >= 0


@pytest.mark.parametrize(("count", "size"), [(60, 0.3), (500, 0.1)])
def test_refit_finds_what_a_new_tree_finds(count, size):
    rng = np.random.default_rng(5)
    vertices, triangles = soup(rng, count, size)
    moved = (vertices * 1.5 + np.sin(3 * vertices)[:, ::-1] + 2).astype(np.float32)
    moved[7] = np.nan
    tree = Bvh16(*arrays(vertices, triangles))
    origins = rng.uniform(-2, 5, (20_000, 3))
    toward = rng.uniform(0, 4, (20_000, 3)) - origins
    before = shoot(tree, origins, toward)
    tree.refit(arrays(moved, triangles)[0])
    fresh = shoot(Bvh16(*arrays(moved, triangles)), origins, toward)
    after = shoot(tree, origins, toward)
    assert (before[0] != after[0]).mean() > 0.1 and (after[0] >= 0).mean() > 0.1
    for a, b in zip(after, fresh, strict=True):
        np.testing.assert_array_equal(a, b)
    tree.refit(arrays(vertices, triangles)[0])
    np.testing.assert_array_equal(shoot(tree, origins, toward)[0], before[0])


def test_a_tree_does_not_depend_on_when_it_is_built():
    mesh = hw.ball(1.0, rings=30)
    one, two = build(mesh), build(mesh)
    np.testing.assert_array_equal(one._memory, two._memory)
    assert one.nbytes < 70 * len(mesh.triangles)


@pytest.mark.parametrize("away", [(1000.0, 0.0, 0.0), (-3000.0, 2000.0, 1000.0)])
@pytest.mark.parametrize("side", [3, 9])
def test_small_triangles_far_from_the_origin_are_told_apart(away, side):
    """A bumpy grid of centimetres, a kilometre off; side 3 makes a list, side 9 a tree. Aimed at by float64."""
    rng = np.random.default_rng(side)
    x, y = np.meshgrid(np.arange(side + 1), np.arange(side + 1))
    points = np.stack([x.ravel(), y.ravel(), rng.random(x.size)], axis=1) * 0.01
    vertices = (points + away).astype(np.float32)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    lower = np.stack([first, first + 1, first + side + 2], axis=1)
    upper = np.stack([first, first + side + 2, first + side + 1], axis=1)
    triangles = np.concatenate([lower, upper])
    tree = Bvh16(*arrays(vertices, triangles))
    assert (tree.levels == 0) == (side == 3)
    corners = vertices[triangles].astype(np.float64)
    weights = rng.dirichlet((3, 3, 3), (20, len(triangles)))
    weights = 0.9 * weights + 0.1 / 3
    targets = np.einsum("nmk,mkj->nmj", weights, corners).reshape(-1, 3)
    origins = np.add(targets, (0.01, -0.02, 0.1)).astype(np.float32)
    directions = (targets - origins.astype(np.float64)).astype(np.float32)
    triangle, *_ = shoot(tree, origins, directions)
    expected = np.tile(np.arange(len(triangles)), 20)
    assert (triangle == expected).mean() > 0.97


def test_what_lies_behind_a_ray_is_not_hit_however_thin_it_is():
    """Slivers metres long and millimetres high, right behind where rays begin: the planes decide, in float64."""
    rng = np.random.default_rng(4)
    count, rays = 700, 400_000
    along, across = directions(rng, count), directions(rng, count)
    start = rng.uniform(-3, 3, (count, 3))
    far = start + rng.uniform(2, 5, (count, 1)) * along
    third = start + rng.uniform(0, 1, (count, 1)) * (far - start) + 0.003 * across
    vertices = np.stack([start, far, third], axis=1).reshape(-1, 3).astype(np.float32)
    indices = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    corners = vertices[indices].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    of = rng.integers(count, size=rays)
    weights = rng.dirichlet((1, 1, 1), rays)
    normal = normals[of] / np.linalg.norm(normals[of], axis=1, keepdims=True)
    origins = (np.einsum("rk,rkj->rj", weights, corners[of]) + 5e-5 * normal).astype(np.float32)
    toward = directions(rng, rays).astype(np.float32)
    toward *= np.sign(np.einsum("rj,rj->r", toward, normal))[:, None].astype(np.float32)
    triangle, t, _, found = shoot(Bvh16(*arrays(vertices, indices)), origins, toward)
    hit = triangle >= 0
    n, d = normals[triangle[hit]], toward[hit].astype(np.float64)
    true_t = np.einsum("rj,rj->r", corners[triangle[hit], 0] - origins[hit], n) / np.einsum("rj,rj->r", d, n)
    assert hit.sum() > 1000
    assert np.all(true_t >= 0), ((true_t < 0).sum(), t[hit][true_t < 0].max())
    np.testing.assert_array_equal(found, hit)
