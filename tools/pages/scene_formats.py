"""What docs/scene-formats.md says of other programs' files: a row a format."""

INTRODUCTION = """## What is read of other programs' files

A warning names whatever is left out. With `--strict`, clsim refuses such a file instead.
"""
ROWS = (
    (
        "glTF 2.0 (`.gltf`, `.glb`)",
        "triangles, skins, morph targets, all animations of nodes, lamps and emissive materials; cameras, "
        "orthographic ones too; `KHR_lights_punctual`, instancing, quantisation, Draco (extra `draco`), texture "
        "transforms, WebP",
        "points and lines; a file that requires meshopt or KTX2 is refused, and the error names the tool that unpacks"
        " it (`gltfpack`, `gltf-transform`); textures of clearcoat, specular and transmission are replaced by their "
        "mean; anisotropic roughness is replaced by the mean of both directions; thin films have the same colour from"
        " all directions, that from above; ranges of lamps; colours of vertices in morph targets and of unlit "
        "materials; other extensions; if two keyframes have the same time, the last is used",
    ),
    (
        "USD (extra `usd`)",
        "meshes, simple solids, instances and instancers, also within each other; points, as small spheres; preview "
        "surfaces, and MaterialX's standard surface, OpenPBR and glTF's, with pictures; colours that a mesh gives its"
        " material; cameras, orthographic ones too; lamps and domes; motion, skins",
        "single prims with a value that cannot be used; subdivision (the mesh gets smooth normals instead); curves, "
        "volumes; of MaterialX: sheen, subsurface, thin films, anisotropy, refraction, all nodes but pictures and "
        "values, and `.mtlx` files, which usd-core does not open; other materials; prims that appear or vanish; "
        "what else than places, points and light changes with time; light filters, profiles and links; a second set "
        "of texture coordinates. Faces are visible from both sides, also where `doubleSided` is false",
    ),
    (
        "Mitsuba (`.xml` of 0.6 to 3)",
        "shapes, groups and instances, perspective, thin-lens and orthographic cameras with crop windows, radial "
        "distortion, lamps, sky maps, projectors, skies and suns, animated transforms",
        "media that scatter, other sensors and emitters, `hide_emitters`; all keyframes of an object have the scale of "
        "the first",
    ),
    (
        "pbrt-v4 (`.pbrt`, and what it includes in `.pbrt.gz` and `.ply.gz`)",
        "shapes, instances, perspective and orthographic cameras that move, with crop and screen windows, point, spot,"
        " distant and infinite lights with their power or illuminance, area lights",
        "media, images and powers of area lights, those within objects, other cameras, lights and shapes; subdivision "
        "(the mesh gets smooth normals instead); primaries other than sRGB's; curves of pictures other than sRGB's",
    ),
    (
        "OBJ, PLY",
        "polygons, colours of vertices, materials of an `.mtl`",
        "all else",
    ),
    (
        "MuJoCo models (`.xml`; extra `mujoco`)",
        "geoms, meshes, materials, lights and the first camera (a model without cameras is seen from the initial view"
        " of MuJoCo's viewer); bodies move by the model's physics from its initial state, all controls at 0 (5 s, "
        "unless `--duration` says more); for models that your program controls, see [MuJoCo](robots.md#mujoco)",
        "flexible bodies, skins, tendons, sites, skyboxes, lights of pictures, mirrors; textures of other things than "
        "colours; textures on round geoms are replaced by their mean",
    ),
)
"""Format, what is read, and what is left out or approximated."""
AXES = """A camera looks, and a lamp shines, along its own axis, transformed by the matrix above it. That matrix may
mirror, stretch or shear. Mitsuba's mirrored cameras show a mirrored picture, and their sidecars have a
negative `fx`. Mirrored cameras of glTF and USD do not mirror the picture, as in the viewers of these formats.
A sky under a mirroring matrix is mirrored.

An orthographic camera (in a TOML `lens = { model = "orthographic", view_width_m = 2.0 }`) sees along parallel
rays. The rays begin in the plane of the camera's position. If the camera's parent node is scaled, the view is
scaled too. Near and far planes of cameras cut nothing off.
"""


def section() -> str:
    """Return the page's section."""
    head = "| format | what is read | what is left out or approximated |\n|---|---|---|\n"
    return f"{INTRODUCTION}\n{head}" + "".join(f"| {' | '.join(row)} |\n" for row in ROWS) + f"\n{AXES}\n"
