"""Materials, textures and cut-outs against Mitsuba 3 on the same scene: block means by z-score, and the total."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import ImageTexture, Material
from tests.render import hand_worlds as hw

pytestmark = pytest.mark.oracle
WHITE = (1.0, 1.0, 1.0)
SIZE, BLOCK = 32, 8
GOLD = {"eta": (0.143, 0.375, 1.442), "k": (3.983, 2.386, 1.603)}


@dataclass(frozen=True)
class Case:
    """Our material, and Mitsuba's; ``texture`` is ours, with ``bitmap`` what names Mitsuba gives it."""

    material: Material
    bsdf: dict
    smooth: bool = False
    texture: ImageTexture | None = None


def rgb(color):
    return {"type": "rgb", "value": list(color)}


def spectrum(color):
    return {"type": "rgb", "value": list(color)}


def two_sided(bsdf):
    return {"type": "twosided", "inner": bsdf}


METAL = {"eta": spectrum(GOLD["eta"]), "k": spectrum(GOLD["k"])}
PICTURE = ImageTexture(
    np.random.default_rng(2).integers(0, 256, (6, 9, 4), dtype=np.uint8), uv_matrix=((3, 0, 0), (0, 2, -1))
)


def metal(alpha):
    return {"type": "roughconductor", "distribution": "ggx", "alpha": alpha, **METAL}


def plastic(alpha, nonlinear):
    rough = {"type": "roughplastic", "distribution": "ggx", "alpha": alpha} if alpha else {"type": "plastic"}
    color = rgb((0.7, 0.4, 0.2))
    return {**rough, "diffuse_reflectance": color, "nonlinear": nonlinear, "int_ior": 1.5, "ext_ior": 1.0}


def ours(kind, **values):
    return Material(kind=kind, **({"color": WHITE, "ior": 1.5} | values))


GLASS = {"int_ior": 1.5, "ext_ior": 1.0}
CASES = {
    "diffuse": Case(
        ours("diffuse", color=(0.7, 0.4, 0.2)), two_sided({"type": "diffuse", "reflectance": rgb((0.7, 0.4, 0.2))})
    ),
    "smooth normals": Case(
        ours("diffuse", color=(0.7, 0.4, 0.2)),
        two_sided({"type": "diffuse", "reflectance": rgb((0.7, 0.4, 0.2))}),
        smooth=True,
    ),
    "mirror of gold": Case(ours("conductor", **GOLD), two_sided({"type": "conductor", **METAL})),
    "gold .1": Case(ours("conductor", alpha=0.1, **GOLD), two_sided(metal(0.1))),
    "gold .5": Case(ours("conductor", alpha=0.5, **GOLD), two_sided(metal(0.5))),
    "white metal .3": Case(
        ours("conductor", alpha=0.3),
        two_sided({"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": 0.3}),
    ),
    "glass": Case(ours("dielectric"), {"type": "dielectric", **GLASS}),
    "rough glass .1": Case(
        ours("dielectric", alpha=0.1), {"type": "roughdielectric", "distribution": "ggx", "alpha": 0.1, **GLASS}
    ),
    "rough glass .4": Case(
        ours("dielectric", alpha=0.4), {"type": "roughdielectric", "distribution": "ggx", "alpha": 0.4, **GLASS}
    ),
    "panes": Case(ours("thin-dielectric"), {"type": "thindielectric", **GLASS}),
    "plastic": Case(ours("plastic", color=(0.7, 0.4, 0.2)), two_sided(plastic(0.0, False))),
    "plastic nonlinear": Case(ours("plastic", color=(0.7, 0.4, 0.2), nonlinear=True), two_sided(plastic(0.0, True))),
    "plastic .1": Case(ours("plastic", color=(0.7, 0.4, 0.2), alpha=0.1), two_sided(plastic(0.1, False))),
    "plastic .4": Case(
        ours("plastic", color=(0.7, 0.4, 0.2), alpha=0.4, nonlinear=True), two_sided(plastic(0.4, True))
    ),
    "picture": Case(
        ours("diffuse", texture=0), two_sided({"type": "diffuse", "reflectance": "bitmap"}), texture=PICTURE
    ),
    "picture, mirrored nearest": Case(
        ours("diffuse", texture=0),
        two_sided({"type": "diffuse", "reflectance": "bitmap"}),
        texture=replace(PICTURE, nearest=True, wrap_u="mirror", wrap_v="mirror"),
    ),
    "half there": Case(
        ours("diffuse", color=(0.7, 0.4, 0.2), alpha_mode="blend", opacity=0.6),
        {"type": "mask", "opacity": 0.6, "inner": two_sided({"type": "diffuse", "reflectance": rgb((0.7, 0.4, 0.2))})},
    ),
}


def our_world(case):
    """A ball of the material over a grey floor, under a lamp and a sky; with textures a square instead."""
    floor = hw.quad((-4, -1, 4), (8, 0, 0), (0, 0, -8), material=1)
    lamp = hw.quad((-1.5, 2.5, -1.0), (2, 0, 0), (0, 0, 2), material=2)
    thing = (
        hw.ball(1.0, rings=24, smooth=case.smooth)
        if case.texture is None
        else hw.quad((-1, -0.9, 0.5), (2, 0, 0), (0, 2, -0.8))
    )
    return hw.world(
        thing,
        floor,
        lamp,
        materials=(case.material, hw.GREY, Material(color=(0, 0, 0), emission=(6.0, 5.0, 4.0), emits_behind=False)),
        textures=() if case.texture is None else (case.texture,),
        environment=(0.3, 0.4, 0.5),
        view=hw.camera(hw.look_from((0.5, 1.2, 4.0), (0, -0.2, 0)), SIZE, SIZE, fov_deg=40),
    )


def ply(path, mesh):
    """Write a mesh for Mitsuba."""
    columns = [mesh.vertices]
    names = ["x", "y", "z"]
    if mesh.normals is not None:
        columns.append(mesh.normals)
        names += ["nx", "ny", "nz"]
    if mesh.uvs is not None:
        columns.append(mesh.uvs)
        names += ["u", "v"]
    head = [f"element vertex {len(mesh.vertices)}", *(f"property float {name}" for name in names)]
    head += [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(repr(float(x)) for x in row) for row in np.concatenate(columns, axis=1)]
    faces = [f"3 {a} {b} {c}" for a, b, c in mesh.triangles]
    path.write_text("\n".join(["ply", "format ascii 1.0", *head, *rows, *faces, ""]))
    return str(path)


def mitsuba_scene(mi, case, folder, world):
    bsdfs = [
        case.bsdf,
        two_sided({"type": "diffuse", "reflectance": rgb(hw.GREY.color)}),
        {"type": "diffuse", "reflectance": rgb((0, 0, 0))},
    ]
    if case.texture is not None:
        texture = case.texture
        bitmap = {
            "type": "bitmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(texture.pixels[..., :3])),
            "filter_type": "nearest" if texture.nearest else "bilinear",
            "wrap_mode": texture.wrap_u,
            "to_uv": mi.ScalarTransform4f().scale([3, 2, 1]),
        }
        bsdfs[0] = two_sided({"type": "diffuse", "reflectance": bitmap})
    pose = world.camera.motion.pose(0.0) @ np.diag([-1.0, 1, -1, 1])
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 16, "rr_depth": 100},
        "sky": {"type": "constant", "radiance": rgb(world.environment)},
        "camera": {
            "type": "perspective",
            "fov": world.camera.fov_deg,
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(pose.tolist()),
            "film": {
                "type": "hdrfilm",
                "width": SIZE,
                "height": SIZE,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
            },
        },
    }
    for i, mesh in enumerate(world.meshes):
        shape = {
            "type": "ply",
            "filename": ply(folder / f"{i}.ply", mesh),
            "bsdf": bsdfs[i],
            "face_normals": mesh.normals is None,
            "flip_tex_coords": True,
        }
        if i == 2:
            shape["emitter"] = {"type": "area", "radiance": rgb(world.materials[2].emission)}
        scene[f"shape{i}"] = shape
    return mi.load_dict(scene)


def blocks(picture):
    """Means of blocks, ``[…, 3]``."""
    n = SIZE // BLOCK
    return picture.reshape(n, BLOCK, n, BLOCK, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("name", CASES)
def test_mitsuba_sees_the_same(name, mi, tmp_path):
    case = CASES[name]
    world = our_world(case)
    scene = mitsuba_scene(mi, case, tmp_path, world)
    runs, spp = 8, 512
    theirs = np.array([blocks(np.array(mi.render(scene, spp=spp, seed=seed))) for seed in range(runs)], float)
    frames = [hw.render(world, spp=spp, max_depth=16, roulette_start=100, seed=100 + i, threads=2) for i in range(runs)]
    own = np.array([blocks(np.moveaxis(hw.radiance(frame), 0, 2)) for frame in frames], float)
    difference = own.mean(axis=0) - theirs.mean(axis=0)
    # Errors pooled over colours and neighbours: eight runs alone know their own spread badly.
    error = np.sqrt((own.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / runs)
    error = np.hypot(error, error.mean(axis=2, keepdims=True)) / np.sqrt(2)
    z = difference / error
    total = own.mean() / theirs.mean() - 1
    spread = error.mean() / np.sqrt(error[..., 0].size) / theirs.mean()
    print(f"{name}: total {total:+.3%} ± {spread:.3%}, rms z {np.sqrt((z**2).mean()):.2f}, worst {np.abs(z).max():.1f}")
    assert abs(total) < 0.002 + 3 * spread
    assert np.abs(z).max() < 6 and np.sqrt((z**2).mean()) < 1.7


@pytest.mark.parametrize("name", ["diffuse", *(name for name in CASES if name.startswith("plastic"))])
def test_mitsuba_sees_coats_as_they_are_in_cached_light(name, mi, tmp_path):
    """A slope instead of the ball. Cells blur light over some pixels, so blocks differ more than the whole."""
    case = CASES[name]
    slope = hw.quad((-2, -0.9, 1.5), (4, 0, 0), (0, 1.0, -3))
    world = our_world(case)
    world = replace(world, meshes=(slope, *world.meshes[1:]))
    scene = mitsuba_scene(mi, case, tmp_path, world)
    theirs = np.mean([blocks(np.array(mi.render(scene, spp=512, seed=seed))) for seed in range(4)], axis=0)
    frames = []
    for seed in range(4):
        options = RenderOptions(
            spp=128, probe_spp=128, first_hit_rays=64, light_cache=True, sampler="sobol", max_depth=16,
            roulette_start=100, seed=seed, threads=2,
        )  # fmt: skip
        tracer = PathTracer(world, options)
        frame = Frame(page_aligned((len(tracer.names), SIZE, SIZE)), tracer.names)
        tracer.fill(0, frame)
        tracer.close()
        frames.append(blocks(np.moveaxis(frame.planes[:3], 0, 2)))
    own = np.mean(frames, axis=0)
    off = own / theirs - 1
    print(f"{name}: total {own.mean() / theirs.mean() - 1:+.3%}, rms {np.sqrt((off**2).mean()):.3%}")
    assert abs(own.mean() / theirs.mean() - 1) < 0.012
    # In a smooth coat the lamp has an image, smaller than a cell.
    assert np.sqrt((off**2).mean()) < (0.05 if name == "diffuse" or case.material.alpha > 0 else 0.13)
