"""What the world is: the scene schema, loaders and motion."""

from clsim.scene.builder import WorldBuilder
from clsim.scene.describe import describe
from clsim.scene.load import bundled_names, bundled_scenes, load_world
from clsim.scene.motion import Motion, Static, look_at
from clsim.scene.trajectories.paths import read_path
from clsim.scene.validate import validate
from clsim.scene.world import (
    Camera,
    CheckerTexture,
    Deformation,
    EnvironmentMap,
    ImageTexture,
    Instance,
    Lens,
    Material,
    Mesh,
    PunctualLight,
    Sensor,
    SphereLight,
    Texture,
    World,
)

__all__ = [
    "Camera",
    "CheckerTexture",
    "Deformation",
    "EnvironmentMap",
    "ImageTexture",
    "Instance",
    "Lens",
    "Material",
    "Mesh",
    "Motion",
    "PunctualLight",
    "Sensor",
    "SphereLight",
    "Static",
    "Texture",
    "World",
    "WorldBuilder",
    "bundled_names",
    "bundled_scenes",
    "describe",
    "load_world",
    "look_at",
    "read_path",
    "validate",
]
