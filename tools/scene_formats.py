"""What docs/scene-formats.md says of other programs' files: a row a format."""

INTRODUCTION = """## What is read of other programs' files

What is left out is named in a warning; with `--strict` it refuses the file.
"""
ROWS = (
    (
        "glTF 2.0 (`.gltf`, `.glb`)",
        "triangles, skins, morph targets, all animations of nodes, lamps and glow; cameras, orthographic ones too; "
        "`KHR_lights_punctual`, instancing, quantisation, Draco (extra `draco`), texture transforms, WebP",
        "points and lines; a file that requires meshopt or KTX2 is refused, with the tool that unpacks it (`gltfpack`, "
        "`gltf-transform`); textures of clearcoat, specular and transmission count by their mean; brushed "
        "grooves are as rough as the mean of both ways, thin films have the colour that they have from above; other "
        "materials' extensions; of keyframes at one time the last counts",
    ),
    (
        "USD (extra `usd`)",
        "meshes, simple solids, instances and instancers, also within each other; points, as small spheres; preview "
        "surfaces, and MaterialX's standard surface, OpenPBR and glTF's, with pictures; colours that a mesh gives its "
        "material; cameras, orthographic ones too; lamps and domes; what moves, skins",
        "a prim with a value that cannot be used, by itself; subdivision (smooth normals stand in); curves, volumes; "
        "of MaterialX sheen, subsurface, thin films, anisotropy, all nodes but pictures and values, and `.mtlx` files, "
        "which usd-core does not open; other materials; what appears or vanishes; light filters and profiles. "
        "Faces show on both sides, also where `doubleSided` is false",
    ),
    (
        "Mitsuba (`.xml` of 0.6 to 3)",
        "shapes, groups and instances, perspective, thin-lens and orthographic cameras, lamps, sky maps, projectors, "
        "skies and suns, animated transforms",
        "media that scatter, other sensors and emitters, crop windows; keyframes keep the stretch of the first",
    ),
    (
        "pbrt-v4 (`.pbrt`)",
        "shapes, instances, perspective and orthographic cameras that move, point, spot, distant and infinite lights, "
        "area lights",
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
        "more); what a program controls is [driven](robots.md#mujoco)",
        "flexible bodies, skins, tendons, skyboxes, mirrors",
    ),
)
"""Format, what is read, and what is left out or approximated."""
AXES = """A camera or a lamp looks or shines along its axis as the matrix above it has it, also where that mirrors,
stretches or shears. Mitsuba's mirrored cameras show a mirrored picture, and their sidecars tell a negative `fx`; those
of glTF and USD do not, as in their own viewers. A sky under a mirror is mirrored.

An orthographic camera (in a TOML `lens = { model = "orthographic", view_width_m = 2.0 }`) sees along parallel rays that
begin in the plane of its position. The scale of what it hangs from widens its view.
"""


def section() -> str:
    """Return the page's section."""
    head = "| format | what is read | what is left out or approximated |\n|---|---|---|\n"
    return f"{INTRODUCTION}\n{head}" + "".join(f"| {' | '.join(row)} |\n" for row in ROWS) + f"\n{AXES}\n"
