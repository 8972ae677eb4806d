"""Copies in USD files: instances and point instancers, against usd-core's own evaluation."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from clsim.scene import load_world
from tests.scene.usd.usd_files import CAMERA, METRES, MOVING_COPIES, TIMED, mesh, placed, points_at, usda


def test_instances_share_triangles(tmp_path):
    text = f'class "made" {{ {mesh()} }}\n' + "".join(
        f'def Xform "{name}" (instanceable = true\n references = </made>)\n'
        f"{{ {placed(f'double3 xformOp:translate = ({x}, 0, 0)')} }}\n"
        for name, x in (("a", 1), ("b", 5))
    )
    world = load_world(usda(tmp_path, text))
    assert len(world.meshes) == 1
    assert [instance.motion.pose(0.0)[0, 3] for instance in world.instances] == [1, 5]


def test_instances_have_the_materials_that_they_are_given(tmp_path):
    bound = 'prepend apiSchemas = ["MaterialBindingAPI"]'
    text = f'class "made" {{ {mesh()} }}\n' + "".join(
        f'def Xform "{name}" ({bound}\ninstanceable = true\nreferences = </made>)\n'
        f"{{ rel material:binding = </of_{name}> }}\n"
        f'def Material "of_{name}" {{ token outputs:surface.connect = </of_{name}/S.outputs:surface>\n'
        f'def Shader "S" {{ uniform token info:id = "UsdPreviewSurface"\n'
        f"color3f inputs:diffuseColor = {color}\ntoken outputs:surface }} }}\n"
        for name, color in (("a", (1, 0, 0)), ("b", (0, 0, 1)))
    )
    world = load_world(usda(tmp_path, text))
    found = [world.materials[int(world.meshes[i.mesh].material_ids[0])].color for i in world.instances]
    assert found == [(1, 0, 0), (0, 0, 1)]


def test_copies_stand_where_usd_puts_them(tmp_path):
    larger = placed("float3 xformOp:scale = (2, 2, 2)")
    text = f"""
    def PointInstancer "many"
    {{
        int[] protoIndices = [0, 1, 0]
        point3f[] positions.timeSamples = {{
            10: [(0, 0, 0), (5, 0, 0), (9, 1, 0)],
            34: [(0, 3, 0), (5, 0, 0), (9, 1, 4)]
        }}
        quath[] orientations = [(1, 0, 0, 0), (0.7071, 0, 0.7071, 0), (1, 0, 0, 0)]
        float3[] scales = [(1, 1, 1), (2, 2, 2), (1, 3, 1)]
        rel prototypes = [</many/kinds/a>, </many/kinds/b>]
        {placed("double3 xformOp:translate = (0, 7, 0)")}
        def "kinds" {{ {mesh(name="a")} def Xform "b" {{ {larger} {mesh(name="inner")} }} }}
    }}
    """
    path = usda(tmp_path, text + CAMERA, TIMED)
    world = load_world(path)
    assert sorted(instance.name for instance in world.instances) == ["many/0/a", "many/1/inner", "many/2/a"]
    stage = Usd.Stage.Open(str(path))
    many = UsdGeom.PointInstancer(stage.GetPrimAtPath("/many"))
    square = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)])
    for code in (10, 19, 34):
        matrices = np.array(many.ComputeInstanceTransformsAtTime(code, code))  # with each prototype's own
        for instance in world.instances:
            matrix = matrices[int(instance.name.split("/")[1])]
            expected = square @ matrix[:3, :3] + matrix[3, :3] + (0, 7, 0)
            assert np.allclose(points_at(world, instance, (code - 10) / 24), expected, atol=2e-3)


@pytest.mark.parametrize(
    "changing",
    [
        "float3[] scales.timeSamples = { 10: [(1, 1, 1)], 34: [(3, 3, 3)] }",
        "quath[] orientations.timeSamples = { 10: [(1, 0, 0, 0)], 34: [(0.8, 0, 0.6, 0)] }",
        "quatf[] orientationsf.timeSamples = { 10: [(1, 0, 0, 0)], 34: [(0.8, 0, 0.6, 0)] }",
    ],
)
def test_copies_of_which_one_thing_changes_are_as_it_is_then(tmp_path, changing):
    text = f"""def PointInstancer "one" {{ point3f[] positions = [(1, 0, 0)]
        int[] protoIndices = [0]
        {changing}
        rel prototypes = </one/square>
        {mesh()} }}\n"""
    path = usda(tmp_path, text + CAMERA, TIMED)
    world, stage = load_world(path), Usd.Stage.Open(str(path))
    one = UsdGeom.PointInstancer(stage.GetPrimAtPath("/one"))
    square = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)])
    seen = [points_at(world, world.instances[0], (code - 10) / 24) for code in (10, 16, 22, 34)]
    for code, found in zip((10, 16, 22, 34), seen, strict=True):
        matrix = np.array(one.ComputeInstanceTransformsAtTime(code, code))[0]
        np.testing.assert_allclose(found, square @ matrix[:3, :3] + matrix[3, :3], atol=2e-3)
    assert np.abs(seen[0] - seen[-1]).max() > 0.3


def test_copies_within_copies(tmp_path):
    """Two rows of three boxes 4 apart, 10 above each other; an instancer may itself be what is copied."""
    inner = """def PointInstancer "inner" {
        point3f[] positions = [(-4, 0, 0), (0, 0, 0), (4, 0, 0)]
        int[] protoIndices = [0, 0, 0]
        rel prototypes = </outer/PLACE/box>
        PUT
        def Cube "box" { double size = 1 } }"""
    outer = """def PointInstancer "outer" {
        point3f[] positions = [(0, 0, 0), (0, 10, 0)]
        int[] protoIndices = [0, 0]
        rel prototypes = </outer/TARGET>
        BODY }"""
    for target, place in (("row", "row/inner"), ("inner", "inner")):
        put = "" if target == "inner" else placed("float xformOp:rotateY = 90")  # of its own, before the copies' places
        part = inner.replace("PLACE", place).replace("PUT", put)
        body = part if target == "inner" else f'def Xform "row" {{ {part} }}'
        text = outer.replace("TARGET", target).replace("BODY", body)
        world = load_world(usda(tmp_path, text, METRES, f"{target}.usda"))
        found = sorted(tuple(each.motion.pose(0.0)[:3, 3].round(6).tolist()) for each in world.instances)
        places = [(x, y, 0.0) if target == "inner" else (0.0, y, x) for x in (-4.0, 0.0, 4.0) for y in (0.0, 10.0)]
        assert found == sorted(places)
        assert not world.warnings


@pytest.mark.parametrize(
    "hidden", ["int64[] invisibleIds = [1]", "int64[] ids = [7, 8, 9]\n int64[] invisibleIds = [8]"]
)
def test_copies_that_are_hidden_are_left_out_and_no_others(tmp_path, hidden):
    """`invisibleIds` names copies by their ``ids``, or by their places in the list where they have none."""
    text = f"""def PointInstancer "many" {{
        point3f[] positions = [(0, 0, 0), (0, 3, 0), (0, 6, 0)]
        int[] protoIndices = [0, 0, 0]
        {hidden}
        rel prototypes = </many/box>
        def Cube "box" {{ double size = 1 }} }}"""
    world = load_world(usda(tmp_path, text))
    assert sorted(each.motion.pose(0.0)[1, 3] for each in world.instances) == [0, 6]


@pytest.mark.parametrize(("indices", "wrong"), [([0, 1], 1), ([0, -3], -3)])
def test_copies_of_a_prototype_that_is_not_there_are_told(tmp_path, indices, wrong):
    text = f"""def PointInstancer "many" {{
        point3f[] positions = [(0, 0, 0), (0, 3, 0)]
        int[] protoIndices = {indices}
        rel prototypes = </many/box>
        def Cube "box" {{ double size = 1 }} }}
        def Cube "alone" {{ double size = 1 }}"""
    world = load_world(usda(tmp_path, text))
    assert len(world.instances) == 1
    assert any(f"many are left out: one is of prototype {wrong}, of 1" in each for each in world.warnings)


@pytest.mark.parametrize("moving", [True, False])
def test_copies_in_copies_that_something_between_them_moves_are_told(tmp_path, moving):
    """What moves is neither the inner copies' own places nor the outer ones'."""
    turn = placed("float xformOp:rotateY.timeSamples = { 10: 0, 34: 90 }") if moving else ""
    text = f"""def PointInstancer "outer" {{
        point3f[] positions = [(0, 0, 0), (0, 10, 0)]
        int[] protoIndices = [0, 0]
        rel prototypes = </outer/row>
        def Xform "row" {{ def Xform "turned" {{ {turn} def PointInstancer "inner" {{
            point3f[] positions = [(1, 0, 0)]
            int[] protoIndices = [0]
            rel prototypes = </outer/row/turned/inner/box>
            def Cube "box" {{}} }} }} }} }}"""
    world = load_world(usda(tmp_path, text, TIMED))
    assert any("copies that move within copies" in warning for warning in world.warnings) == moving


def test_copies_that_hold_themselves_end(tmp_path):
    text = """def PointInstancer "outer" {
        point3f[] positions = [(0, 0, 0), (0, 10, 0)]
        int[] protoIndices = [0, 0]
        rel prototypes = </outer/row>
        def Xform "row" { def PointInstancer "again" {
            point3f[] positions = [(1, 0, 0)]
            int[] protoIndices = [0]
            rel prototypes = </outer/row> }
            def Cube "box" {} } }"""
    world = load_world(usda(tmp_path, text))
    assert any("levels deep" in warning for warning in world.warnings) and len(world.instances) < 20


def test_copies_whose_places_take_too_much_memory_are_left_out(tmp_path, monkeypatch):
    path = usda(tmp_path, mesh() + MOVING_COPIES, TIMED)
    for most, count in ((512, 3), (511, 1)):
        monkeypatch.setattr("clsim.scene.usd.stage.MAX_BYTES", most)
        world = load_world(path)
        assert len(world.instances) == count
    assert any("the copies of twice are left out: their places" in warning for warning in world.warnings)


@pytest.mark.parametrize("moving", ["square", "all"])
def test_parts_that_move_within_copies_are_told(tmp_path, moving):
    """What the prototype is in moves it too, but not its copies."""
    turn = placed("float xformOp:rotateY.timeSamples = { 10: 0, 34: 90 }")
    inner, outer = (turn, "") if moving == "square" else ("", turn)
    text = f'def Xform "all" {{ {outer}\n{mesh(inner)} }}\n' + MOVING_COPIES.replace("</square>", "</all/square>")
    world = load_world(usda(tmp_path, text, TIMED))
    told = [warning for warning in world.warnings if "parts that move within copies" in warning]
    assert len(told) == (moving == "square")
