"""Kernels compile for CUDA: what a machine without a GPU can check of the other backend."""

from dataclasses import fields

import pytest
import warp as wp

from clsim.render import RenderOptions, check_device
from clsim.render.features.bsdf_kinds import KINDS
from clsim.render.features.features import Features
from clsim.render.paths.integrator import build_kernel
from clsim.render.scene_data import scene_features
from clsim.scene import load_world

pytestmark = pytest.mark.usefixtures("any_lights")


@pytest.fixture(autouse=True)
def as_for_users(monkeypatch):
    """Compile as for users: what takes half the time for a CPU takes seven times as long for a GPU."""
    monkeypatch.setattr(wp.config, "optimization_level", None)


def compiles_for_cuda(features, folder):
    """Compile a kernel to PTX."""
    check_device("cpu")
    archs = wp.get_cuda_supported_archs()
    if not archs:
        pytest.skip("this build of Warp has no CUDA compiler")
    kernel = build_kernel(features)
    arch = 80 if 80 in archs else archs[0]
    wp.compile_aot_module(kernel.module, device=None, arch=arch, module_dir=folder, use_ptx=True)
    return list(folder.glob("*.ptx"))


@pytest.mark.slow
@pytest.mark.parametrize("replay", [False, True])
def test_the_kernel_of_paths_compiles_for_cuda_with_every_feature_at_once(replay, tmp_path):
    """That of frames, and that which traces stored paths again."""
    odd = {"replay": replay, "strategy": "mis", "projection": "perspective", "kinds": KINDS}
    odd |= dict.fromkeys(("first_hits", "still_lamps", "light_cache", "lamp_light", "requests"), False)
    assert compiles_for_cuda(
        Features(**{field.name: odd.get(field.name, True) for field in fields(Features)}), tmp_path
    )


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "light_cache"), [("two-boxes", False), ("cornell", True)])
def test_the_kernels_of_first_hits_compile_for_cuda(scene, light_cache, tmp_path):
    world = load_world(scene)
    options = RenderOptions(spp=4, probe_spp=1, first_hit_rays=16, light_cache=light_cache)
    assert compiles_for_cuda(options.features(scene_features(world, 0.0), world.camera), tmp_path)
