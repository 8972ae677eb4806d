"""Small scenes of one cause each, rendered from the same file by Mitsuba 3 and by clsim."""

from __future__ import annotations

import numpy as np
import pytest

from clsim.frames import Frame, page_aligned
from clsim.render import PathTracer, RenderOptions
from clsim.scene import load_world

pytestmark = [pytest.mark.oracle, pytest.mark.timeout(600)]
SIZE = 24
SENSOR = f"""
    <integrator type="path"><integer name="max_depth" value="9"/></integrator>
    <sensor type="perspective"><float name="fov" value="50"/>
        <transform name="to_world"><lookat origin="0, 2, 4" target="0, 0.5, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="{SIZE}"/><integer name="height" value="{SIZE}"/>
            <rfilter type="box"/></film>
    </sensor>"""
FLOOR = """<shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.4"/></bsdf></shape>"""
SUN = """<emitter type="directional"><vector name="direction" x="-1" y="-0.8" z="-0.3"/>
    <rgb name="irradiance" value="3"/></emitter>"""
SKY = '<emitter type="constant"><rgb name="radiance" value="0.5, 0.6, 0.8"/></emitter>'


def ours(path, spp):
    tracer = PathTracer(load_world(path), RenderOptions(spp=spp, max_depth=9, threads=2))
    try:
        frame = Frame(page_aligned((len(tracer.names), tracer.height, tracer.width)), tracer.names)
        tracer.fill(0, frame)
        return frame.planes[:3].transpose(1, 2, 0).astype(np.float64)
    finally:
        tracer.close()


def blocks(picture):
    return picture.reshape(SIZE // 4, 4, SIZE // 4, 4, 3).mean(axis=(1, 3))


def assert_alike(mi, folder, body, *, version="3.0.0", spp=2048, mean=0.01, block=0.03, integrator="path"):
    """The means of each channel agree, and blocks of 4×4 pixels to a share of the brightest channel's mean."""
    path = folder / "scene.xml"
    path.write_text(f'<scene version="{version}">{SENSOR.replace("path", integrator, 1)}{body}</scene>')
    reference = np.array(mi.render(mi.load_file(str(path)), spp=spp))[..., :3].astype(np.float64)
    picture = ours(path, spp)
    expected = reference.mean(axis=(0, 1))
    assert expected.max() > 0
    np.testing.assert_allclose(picture.mean(axis=(0, 1)), expected, rtol=mean, atol=mean * 0.1 * expected.max())
    assert np.abs(blocks(picture) - blocks(reference)).max() < block * max(blocks(reference).max(), 1e-9)


def panel(bsdf, emitter='<rgb name="radiance" value="4, 5, 6"/>'):
    """A lamp over the floor that shines down, and whose back the camera sees."""
    place = '<transform name="to_world"><scale value="0.8"/><rotate x="1" angle="70"/><translate y="1"/></transform>'
    return f'<shape type="rectangle">{place}{bsdf}<emitter type="area">{emitter}</emitter></shape>'


DIFFUSE = '<bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.7, 0.2"/></bsdf>'


@pytest.mark.parametrize("bsdf", ["", DIFFUSE, f'<bsdf type="twosided">{DIFFUSE}</bsdf>'])
def test_backs_of_lamps(mi, tmp_path, bsdf):
    assert_alike(mi, tmp_path, FLOOR + SKY + panel(bsdf))


@pytest.mark.parametrize("kind", ["polarizer", "circular", "retarder"])
def test_filters_of_polarisation(mi, tmp_path, kind):
    """A sheet over the floor, which is seen through it and shaded by it."""
    place = '<transform name="to_world"><rotate x="1" angle="-90"/><translate y="1"/></transform>'
    bsdf = f'<bsdf type="{kind}"><float name="transmittance" value="0.7"/></bsdf>'
    assert_alike(mi, tmp_path, FLOOR + SKY + f'<shape type="rectangle">{place}{bsdf}</shape>', spp=512)


def test_emitters_without_a_bsdf_are_black(mi, tmp_path):
    """A floor within a glowing dome: what the dome reflects would be seen everywhere."""
    dome = """<shape type="sphere"><float name="radius" value="9"/><boolean name="flip_normals" value="true"/>
        <emitter type="area"><rgb name="radiance" value="1, 1.5, 2"/></emitter></shape>"""
    assert_alike(mi, tmp_path, FLOOR + dome)


@pytest.mark.parametrize("spectrum", ["400:0.5, 700:0.5", "400:0.2, 500:0.4, 550:0.6, 600:0.1, 700:0.9"])
def test_reflectance_spectra(mi, tmp_path, spectrum):
    """A wall that is given by wavelengths, under white light."""
    bsdf = f'<bsdf type="diffuse"><spectrum name="reflectance" value="{spectrum}"/></bsdf>'
    assert_alike(mi, tmp_path, f'<shape type="cube">{bsdf}</shape>' + SKY, mean=0.02)


@pytest.mark.parametrize("spectrum", ['value="9"', 'type="d65"', 'value="400:1, 500:2, 600:0.5, 700:3"'])
def test_radiance_spectra(mi, tmp_path, spectrum):
    lamp = panel(DIFFUSE, f'<spectrum name="radiance" {spectrum}/>')
    assert_alike(mi, tmp_path, FLOOR + lamp, mean=0.02)


@pytest.mark.parametrize("beam", ["", '<float name="beam_width" value="5"/>'])
def test_spots_fade_linearly_in_the_angle(mi, tmp_path, beam):
    place = '<transform name="to_world"><lookat origin="0, 3, 1" target="0, 0, 0" up="0, 0, 1"/></transform>'
    spot = f"""<emitter type="spot"><rgb name="intensity" value="9, 8, 7"/>
        <float name="cutoff_angle" value="35"/>{beam}{place}</emitter>"""
    assert_alike(mi, tmp_path, FLOOR + spot, spp=512)


@pytest.mark.parametrize("kind", ["dielectric", "thindielectric", "roughdielectric"])
def test_glass_dims_by_its_transmittance(mi, tmp_path, kind):
    """A ball, or a pane, before the floor: red passes by half, green hardly, and blue not at all."""
    tint = '<rgb name="specular_transmittance" value="0.5, 0.05, 0"/>'
    rough = (
        '<float name="alpha" value="0.2"/><string name="distribution" value="ggx"/>'
        if kind == "roughdielectric"
        else ""
    )
    place = '<transform name="to_world"><scale value="0.6"/><translate y="0.9" z="1"/></transform>'
    shape = "rectangle" if kind == "thindielectric" else "sphere"
    ball = f'<shape type="{shape}">{place}<bsdf type="{kind}">{tint}{rough}</bsdf></shape>'
    assert_alike(mi, tmp_path, FLOOR + SKY + ball, spp=1024)


@pytest.mark.parametrize("sun", ['x="1" y="1" z="0.5"', 'x="-1" y="0.2" z="1"'])
@pytest.mark.parametrize("turbidity", [2.0, 5.5])
def test_sky_and_sun(mi, tmp_path, turbidity, sun):
    """A box on a floor, its shadow and its shaded side; between the places of our tables."""
    day = f"""<emitter type="sunsky"><float name="turbidity" value="{turbidity}"/><vector name="sun_direction" {sun}/>
        <transform name="to_world"><rotate x="1" angle="-90"/></transform></emitter>"""
    place = '<transform name="to_world"><scale value="0.5"/><rotate y="1" angle="30"/><translate y="0.5"/></transform>'
    assert_alike(mi, tmp_path, FLOOR + f'<shape type="cube">{place}</shape>' + day, spp=1024, mean=0.02, block=0.05)


@pytest.mark.parametrize("kind", ["sky", "sun"])
def test_sky_and_sun_alone(mi, tmp_path, kind):
    other = {"sky": "sun", "sun": "sky"}[kind]
    day = f'<emitter type="sunsky"><float name="{other}_scale" value="0"/></emitter>'
    assert_alike(mi, tmp_path, FLOOR + day, spp=1024, mean=0.02, block=0.05)


ROUGH = """<bsdf type="roughconductor"><string name="material" value="Au"/><float name="alpha" value="0.2"/>
    <string name="distribution" value="ggx"/></bsdf>"""
SQUARES = """<texture type="checkerboard" name="weight"><rgb name="color0" value="0.9"/><rgb name="color1" value="0.1"/>
    </texture>"""
"""Four, each larger than the blocks that are compared, so that one in another's place is seen."""


@pytest.mark.parametrize("weight", ['<float name="weight" value="0.3"/>', SQUARES], ids=["even", "squares"])
def test_blends(mi, tmp_path, weight):
    """Gold over clay on a panel, evenly or in squares."""
    place = '<transform name="to_world"><scale value="0.8"/><translate y="0.8"/></transform>'
    clay = '<bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.2, 0.1"/></bsdf>'
    both = f'<bsdf type="twosided"><bsdf type="blendbsdf">{weight}{clay}{ROUGH}</bsdf></bsdf>'
    assert_alike(mi, tmp_path, FLOOR + SKY + f'<shape type="rectangle">{place}{both}</shape>', spp=1024)


def test_bump_maps(mi, tmp_path):
    """Waves on a floor, under a lamp that grazes it: their slopes are seen."""
    wave = np.sin(np.linspace(0, 12 * np.pi, 256, endpoint=False))
    heights = np.rint(127.5 + 100 * wave[None, :] * np.ones((64, 1))).astype(np.uint8)
    pytest.importorskip("PIL.Image").fromarray(heights).convert("RGB").save(tmp_path / "waves.png")
    texture = """<texture type="bitmap" name="arbitrary"><string name="filename" value="waves.png"/>
        <boolean name="raw" value="true"/></texture>"""
    place = '<transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/></transform>'
    bumpy = f'<bsdf type="bumpmap">{texture}<float name="scale" value="0.1"/>{DIFFUSE}</bsdf>'
    assert_alike(mi, tmp_path, f'<shape type="rectangle">{place}{bumpy}</shape>' + SUN, spp=512)


def floats(**values):
    return "".join(f'<float name="{name}" value="{value}"/>' for name, value in values.items())


PRINCIPLED = {
    "rough": floats(roughness=0.7, flatness=0.5),
    "sheen": floats(roughness=0.9, sheen=1, sheen_tint=0.7),
    "tinted": floats(roughness=0.3, spec_tint=0.8, specular=0.9),
    "coat": floats(clearcoat=1, clearcoat_gloss=0.4),
    "metal": floats(roughness=0.5, metallic=0.8, anisotropic=0.9),
    "glass": floats(roughness=0.3, spec_trans=0.8, eta=1.4),
}


@pytest.mark.parametrize("lobes", PRINCIPLED.values(), ids=PRINCIPLED)
def test_principled(mi, tmp_path, lobes):
    """A ball and a panel, seen from both sides; what passes light is no panel."""
    bsdf = f'<bsdf type="principled"><rgb name="base_color" value="0.7, 0.3, 0.1"/>{lobes}</bsdf>'
    ball = '<transform name="to_world"><scale value="0.6"/><translate x="-0.6" y="0.7" z="1"/></transform>'
    body = f'<shape type="sphere">{ball}{bsdf}</shape>'
    if "spec_trans" not in lobes:
        place = '<transform name="to_world"><scale value="0.5"/><rotate y="1" angle="-30"/><translate x="0.9" y="0.7"/>'
        body += f'<shape type="rectangle">{place}</transform><bsdf type="twosided">{bsdf}</bsdf></shape>'
        body += f'<shape type="rectangle">{place.replace("-30", "150")}<translate z="-0.3"/></transform>{bsdf}</shape>'
    assert_alike(mi, tmp_path, FLOOR + SKY + SUN + body, spp=1024)


FACETS = {
    "metal": ("roughconductor", '<string name="material" value="Cu"/>' + floats(alpha=0.3)),
    "brushed": ("roughconductor", '<string name="material" value="Al"/>' + floats(alpha_u=0.05, alpha_v=0.4)),
    "glass": ("roughdielectric", floats(alpha=0.3)),
    "polarised coat": ("pplastic", '<rgb name="diffuse_reflectance" value="0.5, 0.2, 0.4"/>' + floats(alpha=0.1)),
    "coat": ("roughplastic", '<rgb name="diffuse_reflectance" value="0.1, 0.2, 0.4"/>' + floats(alpha=0.3)),
}


@pytest.mark.parametrize(("kind", "values"), FACETS.values(), ids=FACETS)
def test_beckmanns_microfacets(mi, tmp_path, kind, values):
    """Mitsuba's default: a ball and a panel, under a low sun; what is brushed shines along u and v differently."""
    bsdf = f'<bsdf type="{kind}">{values}</bsdf>'
    ball = '<transform name="to_world"><scale value="0.6"/><translate x="-0.6" y="0.7" z="1"/></transform>'
    place = '<transform name="to_world"><scale value="0.5"/><rotate y="1" angle="-30"/><translate x="0.9" y="0.7"/>'
    body = f'<shape type="sphere">{ball}{bsdf}</shape>'
    body += f'<shape type="rectangle">{place}</transform>{bsdf}</shape>'
    assert_alike(mi, tmp_path, FLOOR + SKY + SUN + body, spp=1024)


def test_squares_of_roughness(mi, tmp_path):
    """A panel of four squares, rough and nearly smooth: which are which is seen in what it mirrors."""
    squares = SQUARES.replace("weight", "alpha").replace("0.9", "0.02").replace("0.1", "0.5")
    place = '<transform name="to_world"><scale value="1.2"/><translate y="0.8"/></transform>'
    panel = f'<shape type="rectangle">{place}<bsdf type="roughconductor">{squares}</bsdf></shape>'
    assert_alike(mi, tmp_path, FLOOR + SKY + panel, spp=1024)


def test_two_sides_of_their_own(mi, tmp_path):
    other = DIFFUSE.replace("0.8, 0.7, 0.2", "0.1, 0.2, 0.9")
    both = f'<bsdf type="twosided">{DIFFUSE}{other}</bsdf>'
    place = '<transform name="to_world"><scale value="0.6"/><rotate y="1" angle="{}"/><translate x="{}" y="0.8"/>'
    panels = "".join(
        f'<shape type="rectangle">{place.format(*each)}</transform>{both}</shape>' for each in ((20, -0.8), (200, 0.8))
    )
    assert_alike(mi, tmp_path, FLOOR + SKY + SUN + panels, spp=512)


@pytest.mark.parametrize("glass", ["dielectric", "roughdielectric", "principled"])
def test_coloured_glass(mi, tmp_path, glass):
    """A ball of glass that absorbs, with a diffuse ball inside: the way to that, and from it, is dimmed as well."""
    values = {"dielectric": "", "roughdielectric": floats(alpha=0.2), "principled": floats(spec_trans=1, roughness=0.4)}
    ink = '<medium type="homogeneous" name="interior"><rgb name="sigma_t" value="0.1, 0.4, 1"/>'
    place = '<transform name="to_world"><scale value="{}"/><translate y="0.9" z="0.5"/></transform>'
    ball = f'<shape type="sphere">{place.format(0.8)}<bsdf type="{glass}">{values[glass]}</bsdf>{ink}'
    core = f'<shape type="sphere">{place.format(0.3)}{DIFFUSE}</shape>'
    body = FLOOR + SKY + ball + f"{floats(albedo=0, scale=3)}</medium></shape>" + core
    # Mitsuba's plain paths know no media; blocks of its own differ by .045 from seed to seed.
    assert_alike(mi, tmp_path, body, spp=1024, integrator="volpath", block=0.07)


def test_orthographic_pictures(mi, tmp_path, monkeypatch):
    """A box and a ball before a floor, by an uneven, mirrored view."""
    lens = SENSOR.replace('"perspective"', '"orthographic"').replace('<float name="fov" value="50"/>', "")
    lens = lens.replace('name="to_world">', 'name="to_world"><scale x="-1.6" y="1.2"/>')
    monkeypatch.setitem(globals(), "SENSOR", lens)
    place = '<transform name="to_world"><scale value="0.5"/><rotate y="1" angle="30"/><translate y="0.5"/></transform>'
    ball = '<transform name="to_world"><scale value="0.4"/><translate x="0.9" y="0.4" z="0.5"/></transform>'
    body = f'<shape type="cube">{place}{DIFFUSE}</shape><shape type="sphere">{ball}</shape>'
    assert_alike(mi, tmp_path, FLOOR + SUN + SKY + body, spp=1024)
