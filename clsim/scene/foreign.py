"""Scene files of other programs: which loader reads which."""

from __future__ import annotations

from pathlib import Path

from clsim.errors import InputError
from clsim.scene.files import USD_ENDINGS, need_usd
from clsim.scene.world import World

FOREIGN = (".gltf", ".glb", ".obj", ".ply", ".xml", ".pbrt", *USD_ENDINGS)
"""Their endings."""


def load_foreign(path: Path, animation: str | None = None) -> World:
    """Load a file of another program, as it is; ``animation`` is what stands after # in a scene's name."""
    suffix = path.suffix.lower()
    if suffix in (".gltf", ".glb"):
        from clsim.scene.gltf.scene import load_gltf

        return load_gltf(path, animation)
    if suffix == ".xml":
        from clsim.scene.mujoco.scene import is_mjcf, load_mujoco

        if is_mjcf(path):
            if animation is not None:
                raise InputError(f"{path}#{animation}: models of MuJoCo's have no parameters to set")
            return load_mujoco(path)
        from clsim.scene.mitsuba.scene import load_mitsuba

        return load_mitsuba(path, _parameters(path, animation))
    if suffix == ".pbrt":
        from clsim.scene.pbrt.scene import load_pbrt

        return load_pbrt(path)
    if suffix in USD_ENDINGS:
        need_usd(path)
        from clsim.scene.usd.scene import load_usd

        return load_usd(path)
    from clsim.scene.meshes.trimesh_scene import load_bare

    return load_bare(path)


def _parameters(path: Path, text: str | None) -> dict[str, str]:
    """Return what ``name=value&name=value`` says."""
    pairs = [pair.partition("=") for pair in text.split("&")] if text else []
    if wrong := [name for name, equals, _ in pairs if not (name and equals)]:
        raise InputError(f"{path}: got {wrong[0]!r} after #, expected parameters such as spp=64&width=320")
    return {name: value for name, _, value in pairs}
