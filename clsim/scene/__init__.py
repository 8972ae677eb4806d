"""What the world is: the scene schema, loaders and motion."""

from clsim.scene.motion import Motion, Static
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
]
