"""What docs/scenes.md says of other programs' files: a row a format."""

INTRODUCTION = """## What is read of other programs' files

What is left out is named in a warning; with `--strict` it refuses the file.
"""
ROWS = (
    (
        "glTF 2.0 (`.gltf`, `.glb`)",
        "triangles, skins, morph targets, all animations of nodes, lamps and glow; perspective cameras; "
        "`KHR_lights_punctual`, instancing, quantisation, Draco (extra `draco`), texture transforms, WebP",
        "orthographic cameras; points and lines; meshopt and KTX2 where a file requires them refuse it; textures of "
        "clearcoat, specular and transmission count by their mean; anisotropy, iridescence and other materials' "
        "extensions; of keyframes at one time the last counts",
    ),
    (
        "USD (extra `usd`)",
        "meshes, simple solids, instances and instancers, also within each other; preview surfaces; cameras; lamps "
        "and domes; what moves, skins",
        "a prim with a value that cannot be used, by itself; subdivision (smooth normals stand in); points, curves, "
        "volumes; orthographic cameras; materials that are no preview surface; what appears or vanishes; light "
        "filters and profiles",
    ),
    (
        "Mitsuba (`.xml` of 0.6 to 3)",
        "shapes, groups and instances, perspective and thin-lens cameras, lamps, sky maps, projectors, skies and "
        "suns, animated transforms",
        "media that scatter, other sensors and emitters, crop windows; keyframes keep the stretch of the first",
    ),
    (
        "pbrt-v4 (`.pbrt`)",
        "shapes, instances, perspective cameras that move, point, spot, distant and infinite lights, area lights",
        "media, images of area lights, other cameras, lights and shapes",
    ),
    (
        "OBJ, PLY",
        "triangles, colours of vertices, materials of an `.mtl`",
        "all else",
    ),
    (
        "MuJoCo models (`.xml`; extra `mujoco`)",
        "geoms, meshes, materials, lights and the first camera, or where MuJoCo's viewer begins if there is none; "
        "bodies move by the model's physics from its initial state, all controls at 0 (5 s, unless `--duration` says "
        "more); what a program controls is [driven](driving.md#mujoco)",
        "flexible bodies, skins, tendons, skyboxes, mirrors; an orthographic camera is a pinhole that sees as much "
        "in the model's middle",
    ),
)
"""Format, what is read, and what is left out or approximated."""
AXES = """A camera or a lamp looks or shines along its axis as the matrix above it has it, also where that mirrors,
stretches or shears. Mitsuba's mirrored cameras show a mirrored picture, and their sidecars tell a negative `fx`; those
of glTF and USD do not, as in their own viewers. A sky under a mirror is mirrored.
"""


def section() -> str:
    """Return the page's section."""
    head = "| format | what is read | what is left out or approximated |\n|---|---|---|\n"
    return f"{INTRODUCTION}\n{head}" + "".join(f"| {' | '.join(row)} |\n" for row in ROWS) + f"\n{AXES}\n"
