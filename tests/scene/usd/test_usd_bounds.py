"""USD files that never come to an end, or crash usd-core, are refused."""

import os
import zipfile

import pytest

from clsim.errors import InputError
from clsim.scene import load_world
from clsim.scene.usd.stage import _packed
from tests.scene.odd_zips import repack
from tests.scene.usd.usd_files import METRES, mesh, usda


def test_what_unfolds_without_end_is_refused(tmp_path, monkeypatch):
    """Each of sixty prims refers twice to the next: 2⁶⁰ in all, out of a few kilobytes."""
    monkeypatch.setattr("clsim.scene.usd.bounds.CPU_S", 1)
    twice = [
        f'def "p{k}" {{\n'
        + "".join(f'def "{name}" (references = </p{k + 1}>\n) {{ }}\n' for name in ("one", "two"))
        + "}\n"
        for k in range(60)
    ]
    path = usda(tmp_path, mesh(name="p60") + "".join(twice))
    with pytest.raises(InputError) as caught:
        load_world(path)
    assert str(caught.value).startswith(f"{path}: usd-core cannot open it within 1 s of processor time and 8 GiB")


@pytest.mark.parametrize(
    "deep", ['def "a" {\n' * 100_000, 'def "a" {\nint[] x = ' + "[" * 200_000], ids=["prims", "lists"]
)
@pytest.mark.parametrize("packed", [False, True])
def test_text_that_is_nested_too_deep_is_refused(tmp_path, deep, packed):
    """It makes usd-core's parser crash."""
    path = usda(tmp_path, deep)
    if packed:
        path = tmp_path / "scene.usdz"
        with zipfile.ZipFile(path, "w") as package:
            package.writestr("scene.usda", "#usda 1.0\n" + deep)
    with pytest.raises(InputError, match="or it is nested too deep"):
        load_world(path)


@pytest.mark.parametrize(("method", "flags"), [(99, 0), (0, 1)], ids=["a method unknown", "a password"])
def test_a_picture_in_a_package_that_python_cannot_unpack_is_told(tmp_path, monkeypatch, method, flags):
    path = tmp_path / "a.usdz"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("a.png", b"pixels")
    monkeypatch.setattr("clsim.scene.usd.stage.MAX_BYTES", 6)
    assert _packed(path, "a.png") == b"pixels"
    monkeypatch.setattr("clsim.scene.usd.stage.MAX_BYTES", 5)
    with pytest.raises(InputError, match=r"a\.usdz: a\.png is larger than"):
        _packed(path, "a.png")
    monkeypatch.undo()
    repack(path, method, flags)
    with pytest.raises(InputError, match=r"a\.usdz: a\.png cannot be read \("):
        _packed(path, "a.png")


def test_an_embedded_python_opens_files_without_a_trial(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.executable", "")
    assert len(load_world(usda(tmp_path, mesh() + 'def "b" (references = </square>\n) { }')).instances) == 2


VARIANT = """def "b" (variants = { string size = "one" }\nprepend variantSets = "size"\n) {
    variantSet "size" = { "one" (references = </square>\n) { } } }"""


@pytest.mark.parametrize("arc", ["references", "payload", "inherits", "specializes", "subLayers", "variant"])
def test_what_refers_to_nothing_is_opened_once(tmp_path, monkeypatch, arc):
    """And all else is looked at first by a process of its own."""
    monkeypatch.setattr("clsim.scene.usd.bounds.subprocess.run", None)
    assert len(load_world(usda(tmp_path, mesh())).instances) == 1
    with pytest.raises(TypeError):
        body = VARIANT if arc == "variant" else "" if arc == "subLayers" else f'def "b" ({arc} = </square>\n) {{ }}'
        meta = METRES + ("\n    subLayers = [@./scene.usda@]" if arc == "subLayers" else "")
        load_world(usda(tmp_path, mesh() + body, meta, "other.usda"))


@pytest.mark.parametrize(
    ("by", "ending", "far"), [("sublayer", "usda", False), ("reference", "usdc", True), ("reference", "usdz", False)]
)
def test_a_pipe_is_not_waited_for(tmp_path, by, ending, far):
    """Not one that a file names, nor one that another names which it names."""
    os.mkfifo(tmp_path / f"pipe.{ending}")
    named = f"@./pipe.{ending}@"
    body = f'def "b" (references = {named}</square>\n) {{ }}' if by == "reference" else ""
    meta = METRES + (f"\n    subLayers = [{named}]" if by == "sublayer" else "")
    path = usda(tmp_path, mesh() + body, meta)
    if far:
        path = usda(tmp_path, 'def "c" (references = @./scene.usda@</square>\n) { }', name="far.usda")
    with pytest.raises(InputError) as caught:
        load_world(path)
    assert str(caught.value) == f"{path}: refers to {tmp_path}/pipe.{ending}, which is no ordinary file"


def test_a_file_that_waits_for_something_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("clsim.scene.usd.bounds.WALL_S", 0.01)
    path = usda(tmp_path, mesh() + 'def "b" (references = </square>\n) { }')
    with pytest.raises(InputError, match="usd-core has not opened it"):
        load_world(path)


def test_a_clip_that_is_a_pipe_is_not_waited_for(tmp_path):
    """Values are read from it only once a time is asked for, when nothing bounds how long that takes."""
    os.mkfifo(tmp_path / "pipe.usda")
    clips = """(clips = { dictionary default = {
        asset[] assetPaths = [@./pipe.usda@]
        string primPath = "/square"
        double2[] active = [(0, 0)]
    } } )"""
    path = tmp_path / "scene.usda"
    path.write_text(f"#usda 1.0\n({METRES}\n)\n" + mesh().replace('"square"', f'"square" {clips}'))
    with pytest.raises(InputError, match=r"refers to .*pipe\.usda, which is no ordinary file"):
        load_world(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_file_that_was_harmless_is_looked_at_again_when_it_has_changed(tmp_path):
    path = usda(tmp_path, mesh())
    assert load_world(path).instances
    os.mkfifo(tmp_path / "pipe.usda")
    usda(tmp_path, mesh() + 'def "far" (references = @pipe.usda@) {}')
    with pytest.raises(InputError, match="no ordinary file"):
        load_world(path)
