"""Normal maps in the frame of uv, and culled backs, in closed form; pictures are in the slow tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from clsim.render import RenderOptions, SceneData
from clsim.render.accel.geometry import FAR, Geometry, Hit, Surface
from clsim.render.surfaces.alpha import make_alpha
from clsim.render.surfaces.materials import Materials
from clsim.render.surfaces.normal_maps import make_normal_maps
from clsim.scene import ImageTexture, Material
from tests.render import hand_worlds as hw

COUNT, SCALE = 48, 0.7


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_a_normal_map_leans_to_u_and_v_however_these_lie_and_turn():
    """Also where uv is mirrored, as on the other half of a face; from behind, bumps are dents."""
    random = np.random.default_rng(8)
    texels = random.integers(70, 186, (1, COUNT, 4), dtype=np.uint8)
    texels[..., 2:] = 250
    material = Material(normal_texture=0, normal_scale=SCALE)
    world = hw.world(hw.box((-1, -1, -1), (1, 1, 1)), materials=(material,))
    world = replace(world, textures=(ImageTexture(texels, srgb=False, nearest=True),))
    data = SceneData(world)
    mapped_normal = make_normal_maps(RenderOptions().features(data.features, world.camera))

    @wp.kernel(enable_backward=False, module="unique")
    def bend(
        materials: Materials,
        frames: wp.array2d[wp.vec3],
        fronts: wp.array[bool],
        out_normals: wp.array[wp.vec3],
    ) -> None:
        i = wp.tid()
        point = Surface()
        point.front = fronts[i]
        point.normal = wp.where(fronts[i], frames[2, i], -frames[2, i])
        point.shading_normal = point.normal
        point.tangent = frames[0, i]
        point.bitangent = frames[1, i]
        point.uv = wp.vec2((float(i) + 0.5) / float(wp.static(COUNT)), 0.5)
        out_normals[i] = mapped_normal(materials, point, point.normal)

    axes = np.linalg.qr(random.normal(size=(COUNT, 3, 3)))[0]
    across, up, normals = np.moveaxis(axes, 2, 0)
    up = up * np.where(np.arange(COUNT) % 2, 1.0, -1.0)[:, None]
    tangents, bitangents = 2.0 * across, 0.5 * up + random.uniform(-0.2, 0.2, (COUNT, 1)) * across
    fronts = np.arange(COUNT) % 3 > 0
    found = wp.zeros(COUNT, dtype=wp.vec3, device="cpu")
    frames = np.float32([tangents, bitangents, normals])
    given = [wp.array(frames, dtype=wp.vec3, device="cpu"), wp.array(fronts, dtype=bool, device="cpu")]
    wp.launch(bend, COUNT, inputs=[data.scene.materials, *given], outputs=[found], device="cpu")
    x, y, z = (2.0 * texels[0, :, :3] / 255.0 - 1.0).T[..., None]
    expected = unit(SCALE * x * across + SCALE * y * up + z * normals) * np.where(fronts, 1.0, -1.0)[:, None]
    np.testing.assert_allclose(found.numpy(), expected, atol=2e-3)


@pytest.mark.parametrize("from_camera", [True, False])
def test_culled_backs_are_passed_by_rays_of_the_camera_alone(from_camera):
    """Sheets one behind the other; of each it is told whether it is culled, and whether its back is met."""
    boxes = hw.box((-1, -1, -1), (1, 1, 1)), hw.box((2, 2, 2), (3, 3, 3), material=1)
    world = hw.world(*boxes, materials=(Material(), Material(back="culled")))
    data = SceneData(world)
    features = RenderOptions().features(data.features, world.camera)
    sheets = np.array([(k & 1, k >> 1 & 1, k >> 2 & 1, k >> 3 & 1) for k in range(16)])

    @wp.func
    def closest(geometry: Geometry, origin: wp.vec3, direction: wp.vec3, time: float) -> Hit:
        hit = Hit()
        hit.t = FAR
        hit.triangle = -1
        for k in range(2):
            way = origin[2] + float(k + 1)
            if way > 0.0 and hit.triangle < 0:
                hit.triangle = int(time) * 2 + k
                hit.t = way
        return hit

    @wp.func
    def surface_of(geometry: Geometry, hit: Hit, time: float) -> Surface:
        point = Surface()
        point.normal = geometry.vertices[hit.triangle]
        point.reach_m = 1.0
        return point

    @wp.func
    def opacity(materials: Materials, point: Surface) -> float:
        return 1.0

    pierce, _ = make_alpha(features, closest, surface_of, opacity)

    @wp.kernel(enable_backward=False, module="unique")
    def look(geometry: Geometry, materials: Materials, primary: bool, out_t: wp.array[float]) -> None:
        i = wp.tid()
        way = wp.vec3(0.0, 0.0, -1.0)
        out_t[i] = pierce(geometry, materials, wp.vec3(), way, float(i), wp.uint64(0), primary).t

    geometry = Geometry()
    normals = np.zeros((len(sheets), 2, 3), np.float32)
    normals[..., 2] = np.where(sheets[:, 2:], -1.0, 1.0)
    geometry.vertices = wp.array(normals.reshape(-1, 3), dtype=wp.vec3, device="cpu")
    geometry.material_ids = wp.array(sheets[:, :2].ravel(), dtype=int, device="cpu")
    geometry.indices = wp.zeros(6 * len(sheets), dtype=int, device="cpu")
    found = wp.zeros(len(sheets), dtype=float, device="cpu")
    wp.launch(look, len(sheets), inputs=[geometry, data.scene.materials, from_camera], outputs=[found], device="cpu")
    for (*culls, back_a, back_b), way in zip(sheets.tolist(), found.numpy(), strict=True):
        stops = [not (from_camera and cull and back) for cull, back in zip(culls, (back_a, back_b), strict=True)]
        assert way == pytest.approx(1.0 if stops[0] else 2.0 if stops[1] else FAR, rel=1e-3), (culls, back_a, back_b)
