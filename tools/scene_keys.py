"""Write docs/scenes.md: how to describe a scene, with every key that a scene's TOML may hold.

python -m tools.scene_keys docs/scenes.md
"""

from __future__ import annotations

import sys
from pathlib import Path

from clsim.scene.toml.schema import key_table
from tools.scene_formats import section

INTRODUCTION = """# Scenes

`clsim live SCENE` takes the name of a bundled scene (`clsim scenes`), a `.toml` file as described here, or a file of
another program: `.gltf`, `.glb`, `.usd`, `.obj`, `.ply`, Mitsuba's and MuJoCo's `.xml`, `.pbrt`. Where one of these has
no light or no camera, it gets a default light or a camera that orbits it; in a closed room the camera stands, and into
one that is open to one side it looks. A camera that stands still in a still scene is set in gentle motion, for without
motion there are no events. A `.toml` needs a camera and light of its own; one without any light is dark, which a
warning says. What a file asks for and clsim lacks is named once in a warning.

The world is right-handed with +y up; lengths are metres, times seconds, angles degrees. Colours are linear Rec. 709,
radiance is in W·sr⁻¹·m⁻². A camera looks along −z. `fov_deg` is horizontal, and a `--resolution` on the command line
keeps it.

```toml
description = "A red box turns under a lamp"
fps = 120

[camera]
position = [0.0, 1.2, 3.0]
look_at = [0.0, 0.4, 0.0]

[materials.red]
color = [0.6, 0.1, 0.1]

[materials.lamp]
emission = [12.0, 12.0, 11.0]

[[objects]]
shape = "quad"
size = [6.0, 6.0]

[[objects]]
shape = "box"
size = [0.8, 0.8, 0.8]
material = "red"
keyframes = [
  { time_s = 0.0, position = [0.0, 0.4, 0.0], rotation_deg = [0.0, 0.0, 0.0] },
  { time_s = 1.0, position = [0.0, 0.4, 0.0], rotation_deg = [0.0, 90.0, 0.0] },
]

[[objects]]
shape = "quad"
size = [1.0, 1.0]
position = [0.5, 3.0, 0.5]
rotation_deg = [180.0, 0.0, 0.0]
material = "lamp"
```

Unknown keys are errors, as are those that a kind of material does not have; every error is told at once, with its
file and key.

## Your own model, your own camera path

```toml
fps = 240

[camera]
resolution = [640, 480]
fov_deg = 60.0
interpolation = "cubic"
keyframes = [
  { time_s = 0.0, position = [0.0, 1.5, 4.0], look_at = [0.0, 0.5, 0.0] },
  { time_s = 0.5, position = [2.0, 1.5, 3.0], look_at = [0.0, 0.5, 0.0] },
  { time_s = 1.0, position = [3.0, 1.0, 0.0], look_at = [0.0, 0.5, 0.0] },
]

[environment]
radiance = [0.8, 0.9, 1.0]

[[objects]]
file = "model.glb"
```

Save it as `mine.toml` beside `model.glb`, then `clsim live mine.toml --out mine.aedat4`. An animation in the GLB plays
and repeats. Lights in it shine; its camera is not used.

Poses that you have as a file need no TOML. The camera of any scene follows them, and the run lasts as long:

```sh
clsim live model.glb --camera-path poses.txt --resolution 640x480 --out mine.aedat4
```

| file | what is in it |
|---|---|
| `.txt`, `.tum` | the TUM format: lines of `time x y z qx qy qz qw`. A recording's `NAME.poses.txt` is one |
| `.csv` | a header that names `x, y, z, qx, qy, qz, qw` and a time with its unit, as `time_s`; else ESIM's: first ns |
| `.npz` | a time likewise, with `poses` (n × 4 × 4, camera to world), or `positions` and `quaternions` (x, y, z, w) |
| `.glb`, `.gltf` | the first camera's own motion |

Lengths are metres, and the world is the scene's. A camera in these files has +z ahead and +y down; where yours looks
along −z with +y up, add `--camera-axes opengl`. Poses are held exactly and joined by straight lines and slerp, or by
splines with `--camera-interpolation cubic`. In a TOML, `trajectory = "poses.txt"` in `[camera]` takes the same files.

A camera can also move by chance: `wander = { seed = 1 }` in `[camera]` sends it on a smooth random path about its place
or its motion, and `shake = {}` makes it tremble.

## Several cameras

`[camera]` can carry several: a stereo pair, or an event camera beside a camera for frames. Each `[[cameras]]` says
where it sits on it, and in what it differs.

```toml
[[cameras]]
name = "left"

[[cameras]]
name = "right"
position = [0.1, 0.0, 0.0]      # to the right, up, behind
```

`clsim live mine.toml --out '{camera}.aedat4'` then writes `left.aedat4` and `right.aedat4` in one run, over one scene
in memory. Each is as if the camera were alone. Its sidecar, and a recording with truth, tell `extrinsics`: from its
axes to those of each other camera (OpenCV's). Other commands see from `[camera]` itself.

## Files that a scene names

A TOML, Mitsuba or pbrt scene may name any ordinary file by a path relative to its own folder, `../` and links
included, or by a whole path. What a glTF or OBJ names must lie in that file's own folder, for such files often come
from strangers; links there are followed. To let them name files elsewhere, list the folders in the environment variable
`CLSIM_ASSET_FOLDERS`, separated as in `PATH`. Addresses are never followed.

## Many lights

Lamps, bulbs and panels may be many: which one a path asks for light depends on the point that it shall light, by
distance, by where the lamp faces, and by what glossy surfaces mirror (a light tree). A hundred lamps need hardly more
paths than ten. The tree follows lamps that move, where there are more than four; what changes its shape, and
directional light, stands outside it and is drawn by power. `clsim info` says whether a scene has a tree; one with a
single lamp has none.

## Light that changes

Event cameras see what people do not: lamps on the mains flicker at 100 or 120 Hz, dimmed LEDs are switched thousands of
times a second, markers blink. A `modulation` says how the light of a lamp, of a material that emits, or of
`[environment]`, with its daylight and sun, changes. It multiplies the radiance.

```toml
[[sphere_lights]]
name = "ceiling"
radius_m = 0.2
position = [0.0, 2.5, 0.0]
radiance = [40.0, 40.0, 36.0]
modulation = { kind = "sine", frequency_hz = 100, depth = 0.3 }

[materials.marker]
emission = [20.0, 0.0, 0.0]
modulation = { kind = "pwm", frequency_hz = 500, duty = 0.25 }

[environment]
map = "sky.exr"
map_turn_deg_per_s = 10.0
modulation = { kind = "keyframes", keyframes = [{ time_s = 0.0, factor = 0.0 }, { time_s = 1.0, factor = 1.0 }] }
```

- `sine`: 1 + depth·sin(2π·frequency·t). Light on 50 Hz mains flickers at 100 Hz. `depth` is what lamp makers call
  percent flicker.
- `pwm`: on for the share `duty` of each period, from its start on, then `low`.
- `keyframes`: factors at times, joined by lines or, with `interpolation = "step"`, held. A factor may be one number, or
  three for red, green and blue. With `repeat = true` all starts anew at the last time.

A screen is a texture that is a film: numbered pictures, or a video (`pip install 'clsim[video]'`).

```toml
[materials.screen]
color = [0.0, 0.0, 0.0]
emission = [5.0, 5.0, 5.0]
emission_texture = { file = "clip.mp4", repeats = [0.5, 1.0] }  # once on a quad of 2 by 1 m
```

Numbered pictures are `{ frames = "clip/*.png", fps = 30 }`. Each picture is shown until the next. `texture` may be a
film too: a surface whose colours change. At most four of its pictures are in memory. A film starts anew at its end;
with `loop = false` its last picture stays, and the scene lasts until then. Which part of a screen is asked for light
does not follow its pictures.

A spot with a `picture` is a projector, of slides or of films: it shows it over the square around its cone. Mitsuba's
`projector` and its spots with a texture are read too.

In glTF, animations may change what lamps and materials emit (KHR_animation_pointer on a lamp's `color` and `intensity`,
`emissiveFactor` and `emissiveStrength`); what else they point at is named in a warning.

A camera that exposes for a while sees the mean over its exposure, in closed form. Where objects move within the same
exposure, each of their places gets that mean: there is no stroboscope within a frame.

**Frames must be fast enough.** A lamp at 120 Hz looks constant at 120 frames per second. A warning then says which
`--fps` will do: ten frames a period of a sine, two for the shorter of on and off, two from keyframe to keyframe, one
for each picture of a film. A sine of depth .6 then has as many events as its closed form, each within 1.5 % of a
period, and with four times as many frames within .1 %. An edge of PWM is timed to the frame.

In such a scene no light is kept on surfaces, and a pixel gets all its paths in every frame whose light is another. The
gate `delta-r`, and so `--quality published`, does not see light that changes; a warning says so. `--time adaptive`
takes as many frames as such light asks for, up to 1,920 a second ([timing](timing.md)).

## Daylight

```toml
[environment.daylight]
elevation_deg = 35.0        # of the sun; or latitude_deg, longitude_deg and time = 2024-06-21T14:00:00+02:00
azimuth_deg = 120.0         # from north, which is −z, by east, which is +x
turbidity = 3.0             # 2 is very clear air, 10 hazy
```

The sky is Hosek and Wilkie's (SIGGRAPH 2012), the sun a disk of .54° with soft shadows; both are as in Mitsuba 3. The
sun is so to 1.2 %. The sky's light on level ground is so to 1.5 % while the sun is lower than 50°, to 2.5 % above, and
to 7 % in haze from a turbidity of 7 on. Of the sky itself most is right to 2 %, and all of it to 10 %. Radiance is per
nanometre, as there: the sky has about .1, the sun about 10,000. `scale` in `[sensor]` brings that to what your sensor
should see. The ground below the horizon is black: give the scene a floor. Files of Mitsuba 0.6 and older have the sun
of that time, Preetham's (SIGGRAPH 1999), and a ground that reflects .2.
Once the sun is below the horizon there is no daylight, as in Mitsuba 3; a warning says so.

## USD

`.usd`, `.usda`, `.usdc` and `.usdz` need usd-core: `pip install 'clsim[usd]'`. What is read:

- meshes with polygons of any form, subsets with their own materials, points that move, skins; spheres, cubes,
  cylinders, cones, capsules and planes; native instances and point instancers, which share triangles;
- UsdPreviewSurface with its textures, and `displayColor` where there is no material or it asks for that; MaterialX's
  standard surface, OpenPBR and glTF's surface, as far as they tell the same;
- cameras, and lamps of all shapes; domes with a picture; cones of spheres, as spots without size;
- everything that moves, as USD evaluates it at all times; light whose intensity, exposure or colour changes.

A file that refers to others, or to itself, is opened twice, and so are packages and text of more than 16 KiB: first by
a process of its own, which may take 60 s of processor time, ten minutes in all, and 8 GiB. What unfolds to more than
about two million prims, is nested so deep that usd-core crashes, or names a pipe, is refused so.

Units, the axis that points up, and time codes are the file's. A lamp's intensity is its radiance, with `normalize` over
its area in the file's units, as renderers take it. Surfaces have two sides. Surfaces that shall be subdivided are shown
as they are, with smooth normals. Other materials, such as MDL's, are grey, with a warning. A file may name other
files anywhere, as Mitsuba's may. A camera's shutter is not read: pixels of an event camera have none. What appears or
vanishes, and parts that move within a point instancer's copies, are as at the start, with a warning.

## From Blender

Export glTF (`.glb`) with *Cameras* and *Punctual Lights* on and *Apply Modifiers* on; in newer versions set *Lighting
Mode* to *Standard*. Point, spot and sun lamps come through; area lamps and the world's picture do not. Export USD
instead where you have these: it keeps area lamps with their size, and the world as a dome. In both, a material must be
a *Principled BSDF* whose inputs are numbers or image textures: bake what other nodes make. The frame range becomes the
animation; physics and constraints are baked on export, and their keyframes are joined as Blender's frames are.

## Parameters of Mitsuba's files

A value such as `$spp` for which a file has no default is given after its name, in every command:
`clsim live 'scene.xml#spp=64&width=320'`.

## Large scenes

Objects that stand still are one mesh, copies and all; those that move share the triangles of their file. A height field
of 10 million triangles takes 2.7 GB at its peak, 268 bytes a triangle. Until its first event it takes 18 processor
seconds, 3 of them for reading. Then it has .96 million paths a processor second, of at most 8 edges (8 paths a pixel,
96×72). One million triangles take .61 GB and 2.6 s, and have 1.3 million paths a second. `python -m tools.large_scene
10000000 FOLDER` measures this.

## Materials of other programs

- Mitsuba: `diffuse`, `plastic`, `conductor`, `dielectric`, `thindielectric` and their rough kin with the microfacets
  of GGX and Beckmann, `principled`, `blendbsdf`, `mask`, `twosided` (also with two sides of their own), `normalmap`,
  `bumpmap`, `null`; homogeneous media that absorb and do not scatter, in glass. Roughness may differ along u and v.
  With a warning: `pplastic` without polarisation, and Mitsuba 0.6's `phong` and `ward` as diffuse with a rough lobe.
- glTF: metallic-roughness with clearcoat, specular, index of refraction, transmission (a thin wall), volume (solid
  glass that refracts and absorbs), emissive strength and unlit.
- pbrt: `diffuse`, `coateddiffuse`, `conductor`, `dielectric` and `thindielectric`, with the microfacets of GGX.

What else a file asks for is told by a warning, with the first material that it is about; `--strict` refuses such
files.

In two places clsim differs from Mitsuba 3.9 on purpose. Point lights shine through masks and `null` as through holes,
where Mitsuba's `path` lets them cast a shadow. A blend of a perfect mirror with something rough is the mean of both.
In Mitsuba the mirror is too dark: of a mirror with a share of .26 over black, under an even sky, it shows .14.
Where a checkerboard gives a number (roughness, a blend's weight, opacity), its squares are the other way round than
where it gives a colour, as in Mitsuba 3. [Validation](validation.md) has more.

## What glass does to light

Point, spot and directional lights do not shine through glass, neither panes nor solid glass (Mitsuba and pbrt agree):
a warning says so. Put a sphere light or a surface that emits behind it.

## Every key
"""


def text() -> str:
    """Return the whole page."""
    before = "## Materials of other programs"
    return f"{INTRODUCTION.replace(before, section() + before)}\n{key_table().strip()}\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(text())
