"""Write a Mitsuba file of before version 3 as one of version 3.

python -m tools.accuracy.validation_upgrade FILE OUT.xml

OUT.xml has to lie beside FILE, for the files that both name. Mitsuba 3 upgrades names by itself. Told to it is what
else was another: a number is white, not of equal energy; three numbers are R, G and B; colours of sRGB; and skies have
+y up. What Mitsuba 3 lacks becomes diffuse (``phong``, ``ward``, ``roughdiffuse``), or Beckmann's. Shapes whose files
are missing are left out, and named.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

from clsim.scene import load_world
from clsim.scene.light.daylight import SUN_DEG
from clsim.scene.pictures.images import decode_srgb
from tools.peers.mitsuba_files import renew
from tools.peers.mitsuba_variant import load_mitsuba

_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""From a sky with +z up to one with +y up."""
_NUMBER = r"([-+\d.eE]+)"


def written_out(text: str, folder: Path) -> str:
    """Return a file's text without what Mitsuba 3 would read otherwise, or not at all."""

    def present(shape: re.Match[str]) -> str:
        named = re.findall(r'name="filename"\s+value="([^"]+)"', shape[0])
        missing = [name for name in named if not (folder / name).exists()]
        for name in missing:
            print(f"left out: {name}")
        return "" if missing else shape[0]

    def hexadecimal(color: re.Match[str]) -> str:
        return _rgb(color[1], [int(color[2][k : k + 2], 16) / 255 for k in (0, 2, 4)])

    text = re.sub(r"<shape\b[^>]*[^/>]>.*?</shape>", present, text, flags=re.DOTALL)
    text = re.sub(r'<s?rgb ([^>]*?)value="#([0-9a-fA-F]{6})"\s*/>', hexadecimal, text)
    three = r"[ ,]+".join([_NUMBER] * 3)
    text = re.sub(rf'<srgb ([^>]*?)value="{three}"\s*/>', lambda m: _rgb(m[1], [float(m[k]) for k in (2, 3, 4)]), text)
    text = re.sub(rf'<spectrum ([^>]*?)value="{three}"\s*/>', r'<rgb \1value="\2, \3, \4"/>', text)
    text = re.sub(rf'<spectrum ([^>]*?)value="{_NUMBER}"\s*/>', r'<rgb \1value="\2, \2, \2"/>', text)
    lobed = re.compile(r'type="(?:phong|ward)"((?:(?!</bsdf>).)*?)diffuseReflectance', re.DOTALL)
    text = lobed.sub(r'type="diffuse"\1reflectance', text)
    text = re.sub(r'type="(?:phong|ward|roughdiffuse)"', 'type="diffuse"', text)
    return text.replace('value="phong"', 'value="beckmann"')


def _rgb(attributes: str, encoded: list[float]) -> str:
    linear = ", ".join(f"{value:.6g}" for value in decode_srgb(np.array(encoded)))
    return f'<rgb {attributes}value="{linear}"/>'


def upgrade(file: Path, out: Path) -> None:
    """Write the file as version 3."""
    mi = load_mitsuba()
    config = mi.parser.ParserConfig(mi.variant())
    text = written_out(file.read_text(errors="surrogateescape"), file.parent)
    state = mi.parser.parse_string(config, text)
    mi.parser.transform_upgrade(config, state)
    for node in state.nodes:
        renew(mi, node)
        if node.props.plugin_name() != "sunsky":
            continue
        sky = node.props
        if "sun_direction" not in sky:
            out.write_text(text)  # where it stands by place and time, clsim tells; missing files would stop it
            place = load_world(out).sphere_lights[0].motion.pose(0.0)[:3, 3]
            sky["sun_direction"] = mi.ScalarVector3f(*(place / np.linalg.norm(place)).tolist())
            for name in ("year", "month", "day", "hour", "minute", "second"):
                if name in sky:
                    del sky[name]
        turn = np.array(sky.get("to_world", mi.ScalarTransform4f()).matrix)
        sky["to_world"] = mi.ScalarTransform4f(turn @ _UP)
        if "sun_radius_scale" in sky:
            sky["sun_aperture"] = SUN_DEG * sky["sun_radius_scale"]
            del sky["sun_radius_scale"]
    written = mi.parser.write_string(state)
    out.write_text(re.sub(r'<scene version="[^"]+"', '<scene version="3.0.0"', written, count=1))


if __name__ == "__main__":
    upgrade(Path(sys.argv[1]), Path(sys.argv[2]))
