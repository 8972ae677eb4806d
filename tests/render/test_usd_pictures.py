"""One scene as USD, in centimetres and with +z up, and as TOML: the same picture."""

from dataclasses import replace

import numpy as np
import pytest

from clsim.scene import load_world
from tests.render import hand_worlds as hw

pytest.importorskip("pxr")

TOML = """
[camera]
position = [0.0, 1.5, 5.0]
rotation_deg = [-10.0, 0.0, 0.0]
resolution = [32, 24]
fov_deg = 50.0

[environment]
radiance = [0.3, 0.4, 0.5]

[materials.paint]
kind = "principled"
color = [0.5, 0.4, 0.3]
roughness = 0.5

[materials.panel]
color = [0.0, 0.0, 0.0]
emission = [0.0, 6.0, 0.0]
emits_behind = false

[[objects]]
shape = "quad"
size = [6.0, 6.0]
material = "paint"

[[objects]]
shape = "box"
size = [0.8, 0.8, 0.8]
material = "paint"
keyframes = [
  { time_s = 0.0, position = [0.0, 0.6, 0.0], rotation_deg = [0.0, 0.0, 0.0] },
  { time_s = 1.0, position = [1.0, 0.6, 0.0], rotation_deg = [0.0, 90.0, 0.0] },
]

[[objects]]
shape = "quad"
size = [1.0, 0.5]
position = [-1.5, 2.0, 0.0]
rotation_deg = [180.0, 0.0, 0.0]
material = "panel"

[[sphere_lights]]
radius_m = 0.3
position = [1.0, 3.0, 1.0]
radiance = [9.0, 6.0, 3.0]
"""
USD = """#usda 1.0
(
    upAxis = "Z"
    metersPerUnit = 0.01
    startTimeCode = 1
    endTimeCode = 25
    timeCodesPerSecond = 24
)
def Camera "eye"
{
    float horizontalAperture = 20
    float verticalAperture = 15
    float focalLength = 21.445069
    double3 xformOp:translate = (0, -500, 150)
    float xformOp:rotateX = 80
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
}
def DomeLight "sky"
{
    color3f inputs:color = (.3, .4, .5)
}
def SphereLight "bulb"
{
    float inputs:radius = 30
    color3f inputs:color = (9, 6, 3)
    double3 xformOp:translate = (100, -100, 300)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def RectLight "panel"
{
    float inputs:width = 100
    float inputs:height = 50
    float inputs:intensity = 6
    color3f inputs:color = (0, 1, 0)
    double3 xformOp:translate = (-150, 0, 200)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Material "paint"
{
    token outputs:surface.connect = </paint/surface.outputs:surface>
    def Shader "surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (.5, .4, .3)
        float inputs:roughness = .5
        token outputs:surface
    }
}
def Mesh "floor" (prepend apiSchemas = ["MaterialBindingAPI"])
{
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-300, -300, 0), (300, -300, 0), (300, 300, 0), (-300, 300, 0)]
    uniform token subdivisionScheme = "none"
    rel material:binding = </paint>
}
def Cube "box" (prepend apiSchemas = ["MaterialBindingAPI"])
{
    double size = 80
    rel material:binding = </paint>
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 60), 25: (100, 0, 60) }
    float xformOp:rotateZ.timeSamples = { 1: 0, 25: 90 }
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]
}
"""


@pytest.mark.slow
def test_a_scene_as_usd_is_the_picture_of_the_same_as_toml(tmp_path):
    found = []
    for name, text in (("same.toml", TOML), ("same.usda", USD)):
        (tmp_path / name).write_text(text)
        world = load_world(tmp_path / name, resolution=(32, 24))
        assert not world.warnings
        frame = hw.render(replace(world, fps=2.0), index=1, spp=512)
        found.append(frame.planes[:3].astype(np.float64))
    toml, usd = found
    assert usd.mean(axis=(1, 2)) == pytest.approx(toml.mean(axis=(1, 2)), rel=0.005)
    blocks = [each.reshape(3, 6, 4, 8, 4).mean(axis=(2, 4)) for each in found]
    assert np.sqrt(np.mean((blocks[1] - blocks[0]) ** 2)) < 0.03 * toml.mean()
