"""What the world is: the scene schema, loaders and motion."""

from clsim.scene.motion import Motion, Static
from clsim.scene.world import (
    Camera,
    CheckerTexture,
    Instance,
    Material,
    Mesh,
    Sensor,
    SphereLight,
    World,
)

__all__ = [
    "Camera",
    "CheckerTexture",
    "Instance",
    "Material",
    "Mesh",
    "Motion",
    "Sensor",
    "SphereLight",
    "Static",
    "World",
]
