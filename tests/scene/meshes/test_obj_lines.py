"""OBJ files as they are also written: numbers that count back, lines that go on, several libraries, options."""

import numpy as np
import PIL.Image
import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.meshes.trimesh_scene import load_parts, load_triangles

SQUARE = "v 0 0 {z}\nv 1 0 {z}\nv 1 1 {z}\nv 0 1 {z}\n"
LOW, HIGH = SQUARE.format(z=0), SQUARE.format(z=5)


def _written(tmp_path, text):
    (tmp_path / "a.obj").write_text(text)
    return tmp_path / "a.obj"


def _corners(mesh):
    """Return the corners of all triangles in an order of their own."""
    return sorted(mesh.vertices[mesh.triangles].reshape(-1, 9).tolist())


@pytest.mark.parametrize(
    "text",
    [
        LOW + "f -4 -3 -2\n" + HIGH + "f -4 -3 -2\n",
        LOW + "f 1 2 3\n" + HIGH + "  f\t-4\t-3 7\n",
        LOW + HIGH + "f 1 2\\\n3\nf 5 6 \\\r\n7 # 0 -1\n",
    ],
)
def test_faces_count_back_from_their_line_and_go_on_in_the_next(tmp_path, text):
    expected = [[0, 0, z, 1, 0, z, 1, 1, z] for z in (0, 5)]
    assert _corners(load_triangles(_written(tmp_path, text))) == expected


def test_coordinates_and_normals_count_back_each_by_their_own(tmp_path):
    square = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\nf -4/-4/-1 -3/-3/-1 -2/-2/-1\n"
    mesh = load_triangles(_written(tmp_path, LOW + square + HIGH + square.replace("vn 0 0", "vn 0 1")))
    assert sorted(map(tuple, mesh.uvs.tolist())) == [(0, 0), (0, 0), (1, 0), (1, 0), (1, 1), (1, 1)]
    high = mesh.vertices[:, 2] > 1
    assert np.allclose(mesh.normals[high], np.array((0, 1, 1)) / np.sqrt(2)) and np.allclose(mesh.normals[~high, 2], 1)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (LOW + "f 0 1 2\n", "the line 'f 0 1 2' names vertex 0, of 4"),
        (LOW + "f 1 2 9\n", "the line 'f 1 2 9' names vertex 9, of 4"),
        ("f -4 -3 -2\n" + LOW, "the line 'f -4 -3 -2' names vertex -4, of 0 above it"),
        (LOW + "vt 0 0\nf 1/-1 2/-1 3/-2\n", "names texture coordinate -2, of 1 above it"),
        (LOW + "f 1 2 x\n", "the line 'f 1 2 x' has something else where numbers are expected"),
        ("v 1.#IND 0 0\n" + LOW + "f 1 2 3\n", "the line 'v 1.#IND 0 0' has something else where numbers are expected"),
        ("v 0 0 0\nv 1 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\n", "the line 'v 1 0' has fewer than three numbers"),
    ],
)
def test_a_line_that_cannot_be_used_is_quoted(tmp_path, text, part):
    with pytest.raises(InputError, match=r"a\.obj: ") as caught:
        load_world(_written(tmp_path, text))
    assert part in str(caught.value)


def test_several_libraries_are_read_by_line_and_by_name(tmp_path):
    for name, color in (("r", "1 0 0"), ("g", "0 1 0"), ("b c", "0 0 1")):
        (tmp_path / f"{name}.mtl").write_text(f"newmtl {name[0]}\nKd {color}\n")
    faces = "".join(f"usemtl {name}\nf 1 2 3\n" for name in "rgb")
    parts = load_parts(_written(tmp_path, "mtllib r.mtl g.mtl\nmtllib b c.mtl\n" + LOW + faces))
    assert {part.color for part in parts.materials} == {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
    assert not parts.warnings
    parts = load_parts(_written(tmp_path, "mtllib r.mtl no.mtl\n" + LOW + "usemtl r\nf 1 2 3\n"))
    assert parts.materials[0].color == (1, 0, 0)
    assert [warning.startswith("a.obj: the material library no.mtl cannot") for warning in parts.warnings] == [True]


@pytest.mark.parametrize("options", ["-s 2 2.5 -o 1 2 3", "-clamp on -mm 0 1", "-bm 1e-1"])
def test_images_behind_options_are_read_and_the_options_told(tmp_path, options):
    PIL.Image.fromarray(np.full((2, 2, 3), 99, np.uint8)).save(tmp_path / "1 a.png")
    (tmp_path / "a.mtl").write_text(f"newmtl m\nmap_Kd {options} 1 a.png\n")
    faces = "vt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    parts = load_parts(_written(tmp_path, "mtllib a.mtl\n" + LOW + faces))
    assert parts.materials[0].texture == 0
    assert parts.warnings == [f"a.obj: the options of the image 1 a.png are left out ({options})"]


def test_what_materials_ask_for_besides_colour_is_told_once(tmp_path):
    (tmp_path / "a.mtl").write_text(
        "newmtl m\nd 1\nTr 0\nKs 0 0 0\nNs 10\nillum 2\nnewmtl n\nd 0.5\nTr 0.5\nKs 0 0 0.1\nnorm n.png\n"
    )
    parts = load_parts(_written(tmp_path, "mtllib a.mtl\n" + LOW + "usemtl m\nf 1 2 3\nusemtl n\nf 1 3 4\n"))
    assert parts.warnings == [
        f"a.obj: the {feature} of materials is left out (the first is n)" for feature in ("opacity", "gloss", "relief")
    ]


def test_marks_of_byte_order_are_no_part_of_the_first_line(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 1 0 0\n", encoding="utf-8-sig")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" + LOW + "usemtl m\nf 1 2 3\n", encoding="utf-8-sig")
    parts = load_parts(tmp_path / "a.obj")
    assert parts.materials[0].color == (1, 0, 0) and not parts.warnings
    (tmp_path / "a.obj").write_text(LOW + "f 1 2 3\n", encoding="utf-8-sig")
    assert _corners(load_triangles(tmp_path / "a.obj")) == [[0, 0, 0, 1, 0, 0, 1, 1, 0]]


def _area(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


@pytest.mark.parametrize(
    "faces",
    [
        "f 2 3 4 5 6 1\n",
        "f -5 -4 -3 -2 -1 -6\n",
        "f 1 2 3 4\n  f 1/1 4/1 5/1 6/1\t\r\n",
        "f 2//1 3//1 4//1 5//1 6//1 1//1\n",
    ],
)
def test_concave_faces_end_at_their_outline(tmp_path, faces):
    corner = "v 0 0 0\nv 3 0 0\nv 3 1 0\n\tv 1 1 0\nv 1 3 0\nv 0 3 0\nvt 0 0\nvn 0 0 1\n"  # an L of area 5
    assert _area(load_triangles(_written(tmp_path, corner + faces))) == pytest.approx(5)


def test_comments_behind_numbers_and_lines_of_old_macs(tmp_path):
    text = "v 0 0 0 # first\nv 1 0 0\nvt 0 0 # one\nv 1 1 0\nf 1 2 3 # all\n"
    expected = [[0, 0, 0, 1, 0, 0, 1, 1, 0]]
    assert _corners(load_triangles(_written(tmp_path, text))) == expected
    (tmp_path / "a.obj").write_bytes((LOW + "f 1 2 3\nf 1 3 4 1\n").replace("\n", "\r").encode())
    assert _area(load_triangles(tmp_path / "a.obj")) == pytest.approx(1)


@pytest.mark.parametrize(
    ("material", "color", "emission", "told"),
    [
        ("Kd 0.8\nKe 2", (0.8,) * 3, (2, 2, 2), []),
        (
            "Kd 1 0 0\nKe spectral a.rfl 1",
            (1, 0, 0),
            (0, 0, 0),
            ["colours of materials by a spectrum or in XYZ are left out"],
        ),
        ("Kd xyz 0.1 0.2 0.3", (0.5,) * 3, (0, 0, 0), ["colours of materials by a spectrum or in XYZ are left out"]),
        ("Kd 1 0 0\nPr 0.2", (1, 0, 0), (0, 0, 0), ["the gloss of materials is left out (the first is m)"]),
        ("Kd 1 0 0\nPr 1\nPc 0.5", (1, 0, 0), (0, 0, 0), ["the gloss of materials is left out (the first is m)"]),
    ],
)
def test_colours_are_told_in_several_ways(tmp_path, material, color, emission, told):
    (tmp_path / "a.mtl").write_text(f"newmtl m\n{material}\n")
    parts = load_parts(_written(tmp_path, "mtllib a.mtl\n" + LOW + "usemtl m\nf 1 2 3\n"))
    assert parts.materials[0].color == pytest.approx(color)
    assert parts.materials[0].emission == pytest.approx(emission)
    assert parts.warnings == [f"a.obj: {sentence}" for sentence in told]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("s 1\nf 1 2 3\n", ["groups of smooth faces are flat, since the file has no normals"]),
        ("s off\nf 1 2 3\n", []),
        ("vn 0 0 1\ns 1\nf 1//1 2//1 3//1\n", []),
        ("f 1 2 3\ncstype bspline\ndeg 3\ncurv 0 1 1 2 3 4\nend\n", ["curves and curved surfaces are left out"]),
    ],
)
def test_what_faces_ask_for_is_told(tmp_path, lines, told):
    assert load_parts(_written(tmp_path, LOW + lines)).warnings == [f"a.obj: {sentence}" for sentence in told]


def test_an_image_on_a_mesh_without_coordinates_is_told(tmp_path):
    PIL.Image.fromarray(np.full((2, 2, 3), 99, np.uint8)).save(tmp_path / "a.png")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n")
    told = load_parts(_written(tmp_path, "mtllib a.mtl\n" + LOW + "usemtl m\nf 1 2 3\n")).warnings
    assert len(told) == 1 and told[0].endswith("shows one colour: its mesh has no coordinates")
    flat = "vt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
    assert not load_parts(_written(tmp_path, "mtllib a.mtl\n" + LOW + flat)).warnings


def test_a_material_on_no_triangle_is_left_out(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 1 0 0\nnewmtl n\nKd 0 1 0\n")
    world = load_world(_written(tmp_path, "mtllib a.mtl\n" + LOW + "usemtl m\nf 1 3\nusemtl n\nf 1 3 2\n"))
    assert [each.color for each in world.materials] == [(0, 1, 0)]
    assert [" and is left out" in told for told in world.warnings] == [True]
