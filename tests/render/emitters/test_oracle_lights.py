"""Light, planes and variances against Mitsuba 3: Cornell, an environment map, punctual lights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clsim.scene import EnvironmentMap, Lens, Material, PunctualLight, Static, World, load_world
from tests.render import hand_worlds as hw

pytestmark = [pytest.mark.oracle, pytest.mark.timeout(600)]
MAPS = Path(__file__).parents[3].parent / "shared" / "assets" / "hdri"
SIZE, BLOCK = 64, 8
DEPTH = 8


def rgb(values):
    return {"type": "rgb", "value": [float(v) for v in values]}


def translate(mi, world: World, integrator) -> dict:
    """Our world as Mitsuba's dictionary: diffuse triangles, area lights, points, suns and an environment map."""
    transform = mi.ScalarTransform4f
    camera = world.camera
    # Mitsuba's camera looks along +z with +x to the left.
    pose = camera.motion.pose(0.0) @ np.diag((-1.0, 1.0, -1.0, 1.0))
    sensor = {
        "type": "thinlens" if camera.lens.aperture_radius_m else "perspective",
        "fov": camera.fov_deg,
        "fov_axis": "x",
        "to_world": transform(pose),
        "near_clip": 1e-5,  # depth counts from there
        "film": {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "rfilter": {"type": "box"},
            "component_format": "float32",
        },
        "sampler": {"type": "independent"},
    }
    if camera.lens.aperture_radius_m:
        sensor |= {"aperture_radius": camera.lens.aperture_radius_m, "focus_distance": camera.lens.focus_distance_m}
    scene = {"type": "scene", "integrator": integrator, "sensor": sensor}
    for k, instance in enumerate(world.instances):
        mesh, matrix = world.meshes[instance.mesh], instance.motion.pose(0.0)
        for used in np.unique(mesh.material_ids):
            material = world.materials[used]
            triangles = mesh.triangles[mesh.material_ids == used]
            corners = (mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])[triangles].reshape(-1, 3)
            shape = mi.Mesh(f"{k}-{used}", len(corners), len(triangles), props=properties(mi, material))
            parameters = mi.traverse(shape)
            parameters["vertex_positions"] = corners.astype(np.float32).ravel()
            parameters["faces"] = np.arange(len(corners), dtype=np.uint32)
            parameters.update()
            scene[f"shape_{k}_{used}"] = shape
    for k, light in enumerate(world.punctual_lights):
        pose = light.motion.pose(0.0)
        position, axis = pose[:3, 3], -pose[:3, 2]
        if light.kind == "point":
            scene[f"light_{k}"] = {"type": "point", "position": position.tolist(), "intensity": rgb(light.intensity)}
        else:
            scene[f"light_{k}"] = {
                "type": "directional",
                "direction": axis.tolist(),
                "irradiance": rgb(light.intensity),
            }
    if world.environment_map is not None:
        turn = np.eye(4)
        turn[:3, :3] = world.environment_map.to_world
        scene["environment"] = {
            "type": "envmap",
            "bitmap": mi.Bitmap(finer(world.environment_map.radiance)),
            "to_world": transform(turn),
        }
    return scene


def finer(radiance):
    """The same piecewise bilinear function on Mitsuba's grid, whose first and last row are the poles themselves.

    Three columns for each of ours, and rows at the edges and centres of ours, so that every kink is on the grid.
    """
    height, width, _ = radiance.shape
    x = (np.arange(3 * width) + 0.5) / 3 - 0.5
    y = np.clip(np.arange(2 * height + 1) / 2 - 0.5, 0, height - 1)
    x0, y0 = np.floor(x).astype(int), np.minimum(np.floor(y).astype(int), max(height - 2, 0))
    fx, fy = (x - x0)[:, None], (y - y0)[:, None, None]
    rows = radiance[y0] * (1 - fy) + radiance[np.minimum(y0 + 1, height - 1)] * fy
    return (rows[:, x0 % width] * (1 - fx) + rows[:, (x0 + 1) % width] * fx).astype(np.float32)


def properties(mi, material: Material):
    bsdf = {"type": "diffuse", "reflectance": rgb(material.color)}
    result = mi.Properties()
    result["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": bsdf} if material.back == "same" else bsdf)
    if max(material.emission) > 0:
        result["emitter"] = mi.load_dict({"type": "area", "radiance": rgb(material.emission)})
    return result


def cornell():
    world = load_world("cornell")
    camera = replace(world.camera, width=SIZE, height=SIZE)
    meshes = tuple(replace(mesh, normals=None) for mesh in world.meshes)
    return replace(world, camera=camera, meshes=meshes)


def block_world(**rest):
    return hw.world(
        hw.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)),
        hw.box((-0.5, 0.0, -0.4), (0.3, 0.8, 0.2), material=1),
        materials=(Material(color=(0.6, 0.6, 0.6)), Material(color=(0.7, 0.3, 0.2))),
        view=rest.pop("view", hw.camera(hw.look_from((1.0, 1.6, 4), (0, 0.4, 0)), SIZE, SIZE)),
        **rest,
    )


def random_sky():
    pixels = np.random.default_rng(4).exponential(0.3, (12, 24, 3)).astype(np.float32)
    pixels[2, 5] = 40.0
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    return block_world(environment_map=EnvironmentMap(pixels, turn))


def courtyard():
    openexr = pytest.importorskip("OpenEXR")
    path = MAPS / "courtyard.exr"
    if not path.exists():
        pytest.skip("the folder of shared scenes is not there")
    with openexr.File(str(path)) as file:
        channels = file.channels()
        pixels = channels["RGB"].pixels if "RGB" in channels else np.stack([channels[c].pixels for c in "RGB"], -1)
    return block_world(environment_map=EnvironmentMap(np.clip(pixels, 0, 1e4).astype(np.float32), np.eye(3)))


def punctual():
    point = PunctualLight("point", (2.0, 3.0, 4.0), Static(hw.translation(0.9, 1.2, 1.0)))
    sun = PunctualLight("directional", (1.5, 1.2, 0.8), Static(hw.look_from((-2, 3, 1), (0, 0, 0))))
    return block_world(punctual_lights=(point, sun))


def thin_lens():
    world = cornell()
    return replace(world, camera=replace(world.camera, lens=Lens(0.15, 3.0)))


SCENES = {
    "cornell": lambda: (cornell(), 3072),
    "sky": lambda: (random_sky(), 1024),
    "courtyard": lambda: (courtyard(), 1024),
    "punctual": lambda: (punctual(), 256),
    "thin lens": lambda: (thin_lens(), 3072),
}
"""Worlds and samples per pixel."""


def reference(mi, world, spp):
    """Mitsuba's picture of the same paths: means and variances of the mean by name, from its ``moment`` integrator."""
    path = {"type": "path", "max_depth": DEPTH, "rr_depth": 1000}
    planes = {"type": "aov", "aovs": "depth:depth,normal:sh_normal,albedo:albedo", "img": path}
    scene = mi.load_dict(translate(mi, world, {"type": "moment", "nested": planes}))
    passes = [np.array(mi.render(scene, spp=spp // 4, seed=3 + k)).astype(np.float64) for k in range(4)]
    image = np.mean(passes, axis=0)
    names = scene.integrator().aov_names()
    values = dict(zip(names, np.moveaxis(image[..., image.shape[-1] - len(names) :], -1, 0), strict=True))
    means, variances = {}, {}
    for ours, theirs in PLANES.items():
        means[ours] = values[f"nested.{theirs}"]
        variances[ours] = (values[f"m2_nested.{theirs}"] - means[ours] ** 2) / (spp - 1)
    return means, variances


PLANES = {
    **{c: f"img.{c}" for c in "RGB"},
    **{f"Albedo.{c}": f"albedo.{c}" for c in "RGB"},
    **{f"N{c}": f"normal.{c.upper()}" for c in "xyz"},
    "Depth": "depth.T",
}


def blocks(values):
    return values.reshape(SIZE // BLOCK, BLOCK, SIZE // BLOCK, BLOCK).mean(axis=(1, 3))


@pytest.fixture(scope="module")
def pictures(mi):
    """Ours and Mitsuba's, rendered once a scene."""
    found = {}

    def picture(name):
        if name not in found:
            world, spp = SCENES[name]()
            ours = hw.render(world, spp=spp, max_depth=DEPTH, roulette_start=1000, threads=2, seed=1)
            found[name] = ours, *reference(mi, world, spp)
        return found[name]

    return picture


@pytest.mark.parametrize("name", SCENES)
def test_radiance_agrees_block_by_block_and_in_all(pictures, name):
    ours, means, variances = pictures(name)
    for channel in "RGB":
        difference = ours.plane(channel).astype(np.float64) - means[channel]
        variance = ours.plane(f"Variance.{channel}").astype(np.float64) + variances[channel]
        z = blocks(difference) / np.sqrt(blocks(variance) / BLOCK**2 + 1e-12)
        assert np.abs(z).max() < 5, (channel, np.abs(z).max())
        assert (z**2).mean() < 1 + 5 * np.sqrt(2 / z.size), channel
        total = means[channel].mean()
        error = np.sqrt(variance.sum()) / variance.size
        assert error < 0.002 * total, (channel, error / total)
        assert abs(difference.mean()) < 0.002 * total, (channel, difference.mean() / total, error / total)


@pytest.mark.parametrize("name", SCENES)
def test_first_hits_agree_within_their_noise(pictures, name):
    """Where all samples hit: Mitsuba counts those that miss as 0."""
    ours, means, variances = pictures(name)
    full = ours.plane("Coverage") == 1
    assert full.mean() > 0.3
    for plane in [p for p in PLANES if p not in "RGB"]:
        difference = (ours.plane(plane) - means[plane])[full]
        said = (ours.plane(f"Variance.{plane}") + variances[plane])[full]
        z = difference / np.sqrt(np.maximum(said, 0) + 1e-8)  # sums of float32
        assert np.abs(z).max() < 5.5, (plane, np.abs(z).max())
        noisy = said > 1e-6
        if np.count_nonzero(noisy) > 100:
            assert 0.7 < (z[noisy] ** 2).mean() < 1.3, (plane, (z[noisy] ** 2).mean())


def test_variances_agree_where_both_sample_alike(pictures):
    """One lamp and diffuse walls: the same estimator on both sides, so that each pixel's variance is the same."""
    ours, means, variances = pictures("cornell")
    dim = means["G"] < 1.0  # pixels that see the lamp's edge are all variance
    for plane in ("R", "G", "B"):
        ratio = ours.plane(f"Variance.{plane}")[dim].sum() / variances[plane][dim].sum()
        assert abs(ratio - 1) < 0.1, (plane, ratio)
    full = ours.plane("Coverage") == 1
    for plane in ("Depth", "Nx", "Albedo.G"):
        ratio = ours.plane(f"Variance.{plane}")[full].sum() / variances[plane][full].sum()
        assert abs(ratio - 1) < 0.05, (plane, ratio)
