"""Compare clsim's pictures of public scenes with Mitsuba 3's: docs/validation.md and its picture.

python -m tools.accuracy.validation_page FOLDER docs/validation.md docs/images/validation.png --results RESULTS --spp 64

For more paths in some scenes, render these by `tools.accuracy.validation_render` into RESULTS first.

FOLDER holds the repositories named in `SCENES`, which are fetched by whoever runs this, and not shipped. What was
rendered is kept in RESULTS, and not rendered again. Scenes that FOLDER lacks are left out, and named.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from clsim.frames.tonemap import ToneMap

F64 = npt.NDArray[np.float64]
SCENES = {
    "living-room": "living-room/scene_mi3.xml",
    "staircase": "staircase/scene.xml",
    "spaceship": "practical-path-guiding/scenes/spaceship/spaceship.xml",
    "cbox (path guiding)": "practical-path-guiding/scenes/cbox/cbox.xml",
    "cbox (lajolla)": "lajolla_public/scenes/cbox/cbox.xml",
    "sponza": "lajolla_public/scenes/sponza/sponza.xml",
    "matpreview": "lajolla_public/scenes/matpreview/matpreview.xml",
    "veach_mi": "lajolla_public/scenes/veach_mi/mi.xml",
    "bathroom": "dppm-scenes/scenes/bathroom/scene.xml",
    "bathroom2": "dppm-scenes/scenes/bathroom2/scene_v3.xml",
    "classroom": "dppm-scenes/scenes/classroom/scene_v3.xml",
    "dining-room": "dppm-scenes/scenes/dining-room/scene_v3.xml",
    "living-room-2": "dppm-scenes/scenes/living-room-2/scene_v3.xml",
    "spaceship (dppm)": "dppm-scenes/scenes/spaceship/scene.xml",
    "sponza (dppm)": "dppm-scenes/scenes/sponza/scene_v3.xml",
    "torus": "dppm-scenes/scenes/torus/scene_v3.xml",
    "veach-lamp": "dppm-scenes/scenes/veach-lamp/scene_v3.xml",
    "water": "dppm-scenes/scenes/water/scene_v3.xml",
} | {
    name: f"mitsuba-data/docs/scenes/{name}.xml"
    for name in (
        "bsdf_dielectric_glass",
        "bsdf_roughdielectric_rough",
        "bsdf_roughdielectric_textured",
        "bsdf_roughconductor_copper",
        "bsdf_roughplastic_ggx",
        "bsdf_plastic_shiny",
        "bsdf_blendbsdf",
        "bsdf_normalmap_with",
        "bsdf_mask_after",
        "bsdf_twosided_cbox",
        "emitter_spot_no_texture",
        "emitter_spot_texture",
        "emitter_projector_textured",
        "shape_sphere_light_mesh",
        "shape_ply_bunny",
        "texture_checkerboard",
    )
}
"""Where each scene is in the folder. Of spaceship, shapes whose meshes are missing may be taken out; ``lookAt`` in
files before version 3 has to be ``lookat`` for Mitsuba 3.9. `tools.accuracy.validation_upgrade` writes each
``scene_v3.xml``."""
BLOCK = 4
GAP, LABEL, COLUMNS, THUMB = 3, 13, 2, 112


@dataclass(frozen=True)
class Measured:
    """How two renderers compare.

    Attributes:
        ratio: of mean radiance, ours to Mitsuba's, in R, G, B.
        difference: relative RMSE of the means of 4×4 pixels.
        floor: what that is for two renderers that agree, from the differences between seeds.
    """

    ratio: F64
    difference: float
    floor: float


def measure(ours: F64, mitsubas: F64) -> Measured:
    """Compare pictures ``[2, h, w, 3]`` of two seeds each."""
    own, others = (np.stack([_blocks(picture) for picture in each]) for each in (ours, mitsubas))
    scale = others.mean()
    # The mean of two seeds has half of their difference as its error.
    floor2 = sum(float(np.mean((each[0] - each[1]) ** 2)) / 4 for each in (own, others))
    difference = float(np.sqrt(np.mean((own.mean(axis=0) - others.mean(axis=0)) ** 2)))
    ratio = ours.mean(axis=(0, 1, 2)) / mitsubas.mean(axis=(0, 1, 2))
    return Measured(ratio, difference / scale, float(np.sqrt(floor2)) / scale)


def _blocks(picture: F64) -> F64:
    height, width = (side // BLOCK * BLOCK for side in picture.shape[:2])
    cut = picture[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, 3)
    return np.asarray(cut.mean(axis=(1, 3)))


def main() -> None:
    """Render what is missing, measure, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("page", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--only-results", action="store_true", help="render nothing")
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {}
    for name, place in SCENES.items():
        out = options.results / (place.removesuffix(".xml").replace("/", "+") + ".npz")
        scene = options.folder / place
        if not out.exists() and scene.exists() and not options.only_results:
            command = [sys.executable, "-m", "tools.accuracy.validation_render", scene, out, str(options.spp)]
            subprocess.run(command, check=False)
        if out.exists():
            found[name] = dict(np.load(out))
        else:
            print(f"{name}: left out")
    options.page.write_text(page(found, options.picture))
    sheet(found).save(options.picture, optimize=True)


def page(found: dict[str, Any], picture: Path) -> str:
    """Return the page."""
    rows, warned = [], []
    for name, result in found.items():
        m = measure(result["ours"], result["mitsubas"])
        (own_s, own_start_s), (others_s, others_start_s) = result["seconds"]
        red, green, blue = m.ratio
        paths = int(result["spp"])
        times = f"{own_s:.1f} / {others_s:.1f} | {own_start_s:.1f} / {others_start_s:.1f}"
        ratio = f"{red:.3f} {green:.3f} {blue:.3f}"
        rows.append(f"| {name} | {paths} | {ratio} | {m.difference:.4f} | {m.floor:.4f} | {times} |")
        warned += [f"- {name}: {sentence}" for sentence in result["warnings"]]
    lacking = ", ".join(f"`{name}`" for name in SCENES if name not in found) or "none"
    warnings = "\n".join(warned) or "None of these scenes asks for something that clsim lacks."
    mitsuba = importlib.metadata.version("mitsuba")
    return f"""# Validation

This page compares {len(found)} public scenes, rendered by clsim and by Mitsuba {mitsuba} (`llvm_ad_rgb`) from the same
files. Pictures are 160 pixels wide, with two seeds, paths of at most 8 edges, and a box filter. The files are those of
[mitsuba-data](https://github.com/mitsuba-renderer/mitsuba-data),
[lajolla_public](https://github.com/BachiLi/lajolla_public),
[practical-path-guiding](https://github.com/Tom94/practical-path-guiding),
[dppm-scenes](https://github.com/hchoi405/dppm-scenes) and Benedikt Bitterli's
[rendering resources](https://benedikt-bitterli.me/resources/). `tools/accuracy/validation_page.py` writes the page.

![Each scene as clsim and as Mitsuba shows it, and the difference](images/{picture.name})

The left picture is clsim's, the middle one Mitsuba's, and the right one shows the difference. Grey is no difference,
red is where clsim is brighter, and blue where clsim is darker. Full colour is half of the picture's mean.

- **paths**: number of paths for each pixel and seed; more where noise would hide a difference of one percent.
- **ratio**: mean radiance of clsim over Mitsuba's, in R, G and B.
- **difference**: relative RMSE between both, after averaging over 4×4 pixels.
- **floor**: the difference that noise alone would give, estimated from the two seeds of both programs. Where lamps or
  their mirror images are small, few paths find them, and the estimate from two seeds is poor.
- **CPU seconds**: clsim / Mitsuba. *Rendering* is the time of one picture. *Start* is the time before the first
  picture: reading files, building trees, compiling. The machine had other work, so these times are rough.

| scene | paths | ratio | difference | floor | CPU s, rendering | CPU s, start |
|---|---|---|---|---|---|---|
{chr(10).join(rows)}

Not rendered for this page, though in the tool's list: {lacking}.

The files of dppm-scenes are of Mitsuba 0.6. Mitsuba 3 does not read some of them, and reads others differently from
what their authors meant. For these, both programs rendered the output of `tools/accuracy/validation_upgrade.py`:
`bathroom2`, `classroom`, `dining-room`, `living-room-2`, `sponza (dppm)`, `torus`, `veach-lamp` and `water`. Meshes
that were too large to download are missing for both programs: three in `bathroom`, two in `bathroom2` and `spaceship
(dppm)`, one in `living-room-2` and in `water`. The rug of `bathroom` and the view behind the windows of `bathroom2`
are replaced
by a drawn picture.

## What clsim says of these files

{warnings}
{NOTES}"""


NOTES = """
## What disagrees

- `bsdf_blendbsdf`: Mitsuba's gold, a perfect mirror in a blend, is too dark. Mitsuba compares the mirror's discrete
  probability with the density of the rough coat, as if both were of a kind. A mirror with a share of .26 over black
  shows .26 of an even sky; Mitsuba 3.9.1 shows .14, clsim .26. With gold of roughness .01 in place of the mirror,
  Mitsuba's picture is clsim's within .4 %.
- `sponza`: the file is of version 0.4 and gives the lamp's radiance as one number for all wavelengths. Mitsuba of
  that time took this for white, and so does clsim for files before version 3. Mitsuba 3 takes it for equal energy,
  which is reddish.
- `veach_mi` differs in ten pixels on the edges of its smallest lamp, of a radius of .03 and a radiance of 900.
  Without the pixels brighter than 5 (one pixel in 200), the ratio is 1.0006.
- In `living-room` and `staircase`, clsim renders in .93 and .97 of Mitsuba's time, measured by `python -m
  tools.peers.throughput FILE`, which runs both alternately (32 paths, an AMD EPYC). clsim's noise is .334 and .311 of
  the mean, Mitsuba's is .318 and .333. In `spaceship` clsim took 2.2 times as long. The times in the table are older,
  and longer.
- `bsdf_normalmap_with`: Mitsuba 3 darkens places where a normal map bends the normal away from the surface (Estevez
  et al., "A Microfacet-Based Shadowing Function", 2019). With Mitsuba's `use_shadowing_function` off, the ratio is
  nearer to 1 by .0025. The rest, .001 to .003, is also found for the same test ball with other materials.
- `living-room-2`: the blinds in the windows are shells .3 mm thin. Mitsuba starts a ray a little behind its surface.
  This offset grows with the coordinates, and is .5 mm there, so rays skip the shell's second wall. Two such walls
  before a lamp (opacity .97) show .063 in clsim at any place. In Mitsuba they show .063 at the origin, and .54 when
  the scene is moved by 9 m.
- `classroom`, `dining-room` and `torus` have `sunsky`. Version 0.6 had another sun (Preetham's) and a darker ground
  (.2), and clsim reads files of version 0.6 in that way. For this page, both programs read these scenes as files of
  version 3.
- The kitchen of practical-path-guiding is left out. Mitsuba 3 ignores the `scale` of its sky, which is of version
  0.5, and the sky's +y for up. So Mitsuba 3 shows the kitchen hundreds of times darker than clsim. The reference is
  then the authors' own picture, made with Mitsuba 0.6: clsim has .987, 1.004 and 1.003 of its mean, and .995, 1.004
  and 1.001 where the sky is seen directly (128 paths a pixel, of up to 40 edges; six of 295 meshes were missing).
  With the sun and the ground of version 3, the figures were 1.10 and 1.07.
- `torus` and `veach-lamp` are noisy, because few paths find their caustics. With 512 paths `veach-lamp` had 1.011 in
  red, and with 64 paths `torus` had blocks six times as noisy. So both have more paths in the table.
- `classroom` is .6 % darker. Its window shows the sky, and clsim's table of the sky is within 1.5 to 2.5 % of
  Mitsuba's.
- These scenes of dppm-scenes are not compared: `artware`, because four of its meshes were too large to download;
  `bookshelf`, `conference` and `pool`, because one file with nearly all of their meshes was too large; and `box`,
  `glass` and `cbox-caustics`, because their light is caustics of tiny lamps, which paths from the eye seldom find.
  All of them load without the missing meshes, and so do their variants with random materials.
"""


def sheet(found: dict[str, Any]) -> Image.Image:
    """Return all pictures, two scenes a row."""
    tiles = [_tile(name, result) for name, result in found.items()]
    high = [max(tile.height for tile in tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
    canvas = Image.new("RGB", (COLUMNS * tiles[0].width, sum(high)), "white")
    for i, tile in enumerate(tiles):
        canvas.paste(tile, (i % COLUMNS * tile.width, sum(high[: i // COLUMNS])))
    return canvas.quantize(128)


def _tile(name: str, result: Any) -> Image.Image:
    own, others = (result[key].mean(axis=0) for key in ("ours", "mitsubas"))
    tone = ToneMap(follow=0.0)
    shown = [Image.fromarray(tone(np.ascontiguousarray(each, np.float32))) for each in (others, own)][::-1]
    off = (_blocks(own) - _blocks(others)).mean(axis=-1) / (0.5 * max(others.mean(), 1e-9))
    signed = np.clip(off, -1, 1)[..., None]
    grey = np.array([200.0, 200.0, 200.0])
    towards = np.where(signed > 0, [210.0, 30.0, 20.0], [20.0, 60.0, 210.0])
    shown.append(Image.fromarray((grey + np.abs(signed) * (towards - grey)).astype(np.uint8)))
    height = round(THUMB * own.shape[0] / own.shape[1])
    tile = Image.new("RGB", (3 * (THUMB + GAP) + 4 * GAP, height + LABEL + GAP), "white")
    ImageDraw.Draw(tile).text((0, 0), name, fill="black")
    for i, image in enumerate(shown):
        tile.paste(image.resize((THUMB, height), Image.Resampling.BOX), (i * (THUMB + GAP), LABEL))
    return tile


if __name__ == "__main__":
    main()
