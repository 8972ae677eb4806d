"""EXR sequences of every layout, synthesised, and the ways in which they can be wrong."""

import numpy as np
import OpenEXR
import pytest

from clsim.errors import InputError
from clsim.frames import ALL_PLANES, BASE_PLANES, Frame
from clsim.frames.exr import ExrSequence, ExrWriter
from clsim.frames.layouts import recognise

H, W = 6, 9
RNG = np.random.default_rng(0)


def plane(low=0.1, high=1.0):
    return RNG.uniform(low, high, (H, W)).astype(np.float32)


def write(path, channels, **header):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(header, {name: values.copy() for name, values in channels.items()}) as file:
        file.write(str(path))


def write_parts(path, parts):
    """``parts``: name → channels."""
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    made = [OpenEXR.Part(dict(head), {n: v.copy() for n, v in c.items()}, name) for name, c in parts.items()]
    OpenEXR.File(made).write(str(path))


def published():
    names = ("R", "G", "B", "Albedo.R", "Albedo.G", "Albedo.B", "Nx", "Ny", "Nz", "Depth")
    channels = {name: plane() for name in names}
    return channels | {f"Variance.{name}": plane() for name in names}


def read_one(path, **options):
    source = ExrSequence(path, fps=60, **options)
    return source, next(iter(source))


def test_our_own_frames_come_back_bit_for_bit(tmp_path):
    writer = ExrWriter(tmp_path / "out")
    frames = []
    for index in range(3):
        planes = RNG.normal(size=(len(ALL_PLANES), H, W)).astype(np.float32)
        planes[0, 1, 2] = np.nan
        frames.append(Frame(planes, ALL_PLANES, 5_000_000_000_000 + 1000 * index, index))
        file = writer.write(frames[-1])
        assert file.name == f"frame_{index:04d}.exr"
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [f"frame_{k:04d}.exr" for k in range(3)]
    source = ExrSequence(tmp_path / "out")
    assert (source.layout, source.width, source.height, source.frame_count) == ("planes", W, H, 3)
    assert source.names == ALL_PLANES
    for expected, frame in zip(frames, source, strict=True):
        np.testing.assert_array_equal(frame.planes, expected.planes)
        assert (frame.time_us, frame.index) == (expected.time_us, expected.index)
    header = OpenEXR.File(str(tmp_path / "out/frame_0001.exr"), header_only=True).header()
    assert header["index"] == 1 and header["clsim_version"]


def test_a_given_frame_rate_overrides_the_times_of_the_files(tmp_path):
    writer = ExrWriter(tmp_path)
    for index in range(3):
        writer.write(Frame(np.ones((3, H, W), dtype=np.float32), ("R", "G", "B"), 77, index))
    assert [frame.time_us for frame in ExrSequence(tmp_path, fps=30)] == [0, 33333, 66667]


@pytest.mark.parametrize("begin_us", [0, 40_000])
def test_two_files_tell_how_many_there_are_a_second(tmp_path, begin_us):
    writer = ExrWriter(tmp_path)
    for index in range(2):
        writer.write(Frame(np.ones((3, H, W), dtype=np.float32), ("R", "G", "B"), begin_us + 8000 * index, index))
    assert ExrSequence(tmp_path).recorded_fps == 125.0


def test_two_files_of_one_time_have_no_rate(tmp_path):
    writer = ExrWriter(tmp_path)
    for index in range(2):
        writer.write(Frame(np.ones((3, H, W), dtype=np.float32), ("R", "G", "B"), 8000, index))
    with pytest.raises(InputError, match="is at 8000 µs, expected later than 8000 µs of the file before"):
        assert ExrSequence(tmp_path).recorded_fps


def test_published_layout(tmp_path):
    channels = published()
    write(tmp_path / "frame_0000.exr", channels)
    source, frame = read_one(tmp_path)
    assert source.layout == "planes"
    assert set(source.names) == set(channels)
    for name, values in channels.items():
        np.testing.assert_array_equal(frame.plane(name), values)


def test_planes_can_be_chosen(tmp_path):
    channels = published()
    write(tmp_path / "f.exr", channels)
    source, frame = read_one(tmp_path, planes=("R", "G", "B", "Depth"))
    assert source.names == ("R", "G", "B", "Depth")
    np.testing.assert_array_equal(frame.plane("Depth"), channels["Depth"])
    with pytest.raises(InputError, match=r"f\.exr has no plane 'Coverage'; its planes are R, G, B"):
        ExrSequence(tmp_path, fps=60, planes=("R", "Coverage"))


def pbrt_positions(space, camera):
    """Camera-space hits of a perspective camera, a corner of misses, and the same in ``space``."""
    ys, xs = np.mgrid[0:H, 0:W]
    z = 3 + plane()
    seen = np.stack([(xs - W / 2) / W * z, (H / 2 - ys) / W * z, z])
    depth = np.sqrt((seen**2).sum(axis=0))
    if space == "world":
        inverse = np.linalg.inv(camera)
        seen = np.tensordot(inverse[:3, :3], seen, axes=1) + inverse[:3, 3][:, None, None]
    seen[:, :2, :2] = 0
    depth[:2, :2] = 0
    return seen.astype(np.float32), depth


def camera_at(angle, offset):
    matrix = np.eye(4)
    matrix[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    matrix[:3, 3] = offset
    return matrix


@pytest.mark.parametrize("rows", [True, False])
@pytest.mark.parametrize("space", ["camera", "world"])
def test_pbrt_gbuffer(tmp_path, space, rows):
    expected = []
    for k in range(2):
        camera = camera_at(0.4 + 0.1 * k, [1.0, -2.0, 5.0 + k])
        position, depth = pbrt_positions(space, camera)
        expected.append(depth)
        channels = {name: plane() for name in ("R", "G", "B", "Albedo.R", "Albedo.G", "Albedo.B", "dzdx", "u")}
        channels |= {f"P.{axis}": p for axis, p in zip("XYZ", position, strict=True)}
        channels |= {f"{group}.{axis}": plane() for group in ("N", "Ns") for axis in "XYZ"}
        channels |= {f"Variance.{c}": plane() for c in "RGB"}
        # OpenEXR reads the memory of the array, whatever its strides say.
        matrix = np.ascontiguousarray(camera.T if rows else camera, dtype=np.float32)
        write(tmp_path / f"f{k}.exr", channels, worldToCamera=matrix)
    source = ExrSequence(tmp_path, fps=60)
    assert source.layout == "pbrt"
    assert source.names == tuple(n for n in BASE_PLANES if n != "Samples")
    for k, frame in enumerate(source):
        np.testing.assert_allclose(frame.plane("Depth"), expected[k], rtol=1e-4, atol=1e-4)
        np.testing.assert_array_equal(frame.plane("Coverage"), expected[k] > 0)
    np.testing.assert_array_equal(frame.plane("Nx"), channels["Ns.X"])
    np.testing.assert_array_equal(frame.plane("Albedo.G"), channels["Albedo.G"])


def test_pbrt_without_a_camera_has_depth_only_in_camera_space(tmp_path):
    camera = camera_at(0.7, [3.0, 1.0, 2.0])
    depths = {}
    for space in ("camera", "world"):
        position, depths[space] = pbrt_positions(space, camera)
        channels = {name: plane() for name in ("R", "G", "B", "dzdx")}
        channels |= {f"P.{axis}": p for axis, p in zip("XYZ", position, strict=True)}
        write(tmp_path / f"{space}.exr", channels)
    source, frame = read_one(tmp_path / "camera.exr")
    np.testing.assert_allclose(frame.plane("Depth"), depths["camera"], rtol=1e-4)
    source, frame = read_one(tmp_path / "world.exr")
    assert source.names == ("R", "G", "B", "Coverage")
    with pytest.raises(InputError, match="fit no perspective camera"):
        ExrSequence(tmp_path / "world.exr", fps=60, planes=("R", "G", "B", "Depth"))
    with pytest.raises(InputError, match=r"no plane 'Albedo\.R'; its planes are R, G, B, Coverage"):
        ExrSequence(tmp_path / "world.exr", fps=60, planes=("R", "G", "B", "Albedo.R"))


@pytest.mark.parametrize("more", [("P.X", "P.Y", "P.Z"), ("N.X", "N.Y", "N.Z", "dzdx")])
def test_positions_or_normals_alone_make_no_gbuffer_of_pbrt(more):
    """Other renderers name theirs so too."""
    assert recognise(("R", "G", "B", *more), "a.exr").name == "mitsuba"


@pytest.mark.parametrize("image", ["", "img."])
def test_mitsuba_aov(tmp_path, image):
    channels = {f"{image}{c}": plane() for c in "RGBA"}
    channels |= {f"alb.{c}": plane() for c in "RGB"} | {f"nn.{c}": plane() for c in "XYZ"}
    channels |= {f"pos.{c}": plane() for c in "XYZ"} | {"dd.T": plane()}
    channels["dd.T"][2, 3] = 0
    write(tmp_path / "f1.exr", channels)
    source, frame = read_one(tmp_path)
    assert source.layout == "mitsuba"
    assert set(source.names) == set(BASE_PLANES) - {"Samples"}
    np.testing.assert_array_equal(frame.plane("G"), channels[f"{image}G"])
    np.testing.assert_array_equal(frame.plane("Albedo.B"), channels["alb.B"])
    np.testing.assert_array_equal(frame.plane("Ny"), channels["nn.Y"])
    np.testing.assert_array_equal(frame.plane("Depth"), channels["dd.T"])
    assert frame.plane("Coverage").sum() == H * W - 1 and frame.plane("Coverage")[2, 3] == 0


@pytest.mark.parametrize(("geometric", "shading"), [("geo_normal", "sh_normal"), ("NormalGeo", "NormalShading")])
def test_mitsuba_shading_normals_go_before_geometric_ones(tmp_path, geometric, shading):
    """Whoever renders chooses the names."""
    channels = {c: plane() for c in "RGB"} | {f"{g}.{c}": plane() for g in (geometric, shading) for c in "XYZ"}
    write(tmp_path / "f1.exr", channels)
    _, frame = read_one(tmp_path)
    np.testing.assert_array_equal(frame.plane("Nz"), channels[f"{shading}.Z"])


def blender(albedo):
    passes = {"Combined": "RGBA", "Depth": "Z", "Normal": "XYZ", albedo: "RGB", "Vector": "XYZW"}
    channels = {name: {c: plane() for c in suffixes} for name, suffixes in passes.items()}
    channels["Depth"]["Z"][0, :3] = [1e10, np.inf, 1e9]
    return channels


def check_blender(source, frame, passes, albedo):
    assert source.layout == "blender"
    assert set(source.names) == set(BASE_PLANES) - {"Samples"}
    for c in "RGB":
        np.testing.assert_array_equal(frame.plane(c), passes["Combined"][c])
        np.testing.assert_array_equal(frame.plane(f"Albedo.{c}"), passes[albedo][c])
    np.testing.assert_array_equal(frame.plane("Nx"), passes["Normal"]["X"])
    np.testing.assert_array_equal(frame.plane("Depth")[1:], passes["Depth"]["Z"][1:])
    assert frame.plane("Depth")[0, :3].tolist() == [0, 0, 0]
    assert frame.plane("Coverage")[0, :4].tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize("albedo", ["DiffCol", "Denoising Albedo"])
def test_blender_4_multilayer(tmp_path, albedo):
    passes = blender(albedo)
    flat = {f"ViewLayer.{name}.{c}": v for name, group in passes.items() for c, v in group.items()}
    write(tmp_path / "0001.exr", flat)
    check_blender(*read_one(tmp_path), passes, albedo)


def test_of_blenders_albedos_that_of_its_denoiser_is_taken(tmp_path):
    """It has what shines through glass and is seen in mirrors; the diffuse colour alone is black there."""
    passes = blender("Denoising Albedo") | {"DiffCol": blender("DiffCol")["DiffCol"]}
    flat = {f"ViewLayer.{name}.{c}": v for name, group in passes.items() for c, v in group.items()}
    write(tmp_path / "0001.exr", flat)
    check_blender(*read_one(tmp_path), passes, "Denoising Albedo")


@pytest.mark.parametrize("style", ["part", "pass", "full", "short part"])
def test_blender_5_multipart(tmp_path, style):
    """Whether the channels repeat the part's name or not."""
    passes = blender("Diffuse Color")
    part = "{}" if style == "short part" else "ViewLayer.{}"
    channel = {"part": "", "pass": "{}."}.get(style, "ViewLayer.{}.")
    parts = {part.format(n): {channel.format(n) + c: v for c, v in g.items()} for n, g in passes.items()}
    write_parts(tmp_path / "0001.exr", parts)
    check_blender(*read_one(tmp_path), passes, "Diffuse Color")


def test_half_floats_are_read(tmp_path):
    half = {c: plane().astype(np.float16) for c in "RGB"}
    write(tmp_path / "f.exr", half)
    _, frame = read_one(tmp_path)
    np.testing.assert_array_equal(frame.plane("R"), half["R"].astype(np.float32))


def rgb(value=1.0, shape=(H, W)):
    return {c: np.full(shape, value, dtype=np.float32) for c in "RGB"}


def test_natural_order_and_globs(tmp_path):
    for number in (8, 9, 10, 11):
        write(tmp_path / f"shot{number}.exr", rgb(number))
    write(tmp_path / "other1.exr", rgb(0))
    source = ExrSequence(tmp_path / "shot*.exr", fps=10)
    assert [frame.plane("R")[0, 0] for frame in source] == [8, 9, 10, 11]
    with pytest.raises(InputError, match=r"more than one sequence: other# and shot#"):
        ExrSequence(tmp_path, fps=10)


def test_gaps_and_duplicates_in_the_numbering(tmp_path):
    for number in ("0001", "0002", "0004"):
        write(tmp_path / f"f{number}.exr", rgb())
    with pytest.raises(InputError, match=r"frame 3 is missing: .*f0004\.exr follows f0002\.exr"):
        ExrSequence(tmp_path, fps=10)
    write(tmp_path / "f3.exr", rgb())
    assert ExrSequence(tmp_path, fps=10).frame_count == 4
    write(tmp_path / "f03.exr", rgb())
    with pytest.raises(InputError, match="same frame number"):
        ExrSequence(tmp_path, fps=10)


def test_mixed_resolutions_and_missing_channels_name_the_file(tmp_path):
    write(tmp_path / "f0.exr", published())
    write(tmp_path / "f1.exr", rgb(shape=(H, W + 1)))
    write(tmp_path / "f2.exr", {k: v for k, v in published().items() if k != "Ny"})
    write(tmp_path / "f3.exr", {k: np.ones((H + 1, W), np.float32) for k in published()})
    source = ExrSequence(tmp_path, fps=10)
    out = Frame(np.zeros((len(source.names), H, W), np.float32), source.names)
    for index, message in (
        (1, r"f1\.exr has"),
        (2, r"f2\.exr has no channel 'Ny'"),
        (3, r"f3\.exr has 9×7.*f0\.exr has 9×6"),
    ):
        with pytest.raises(InputError, match=message):
            source.fill(index, out)


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("keep", [0.0, 0.02, 0.5, 0.97])
def test_truncated_files(tmp_path, parts, keep):
    big = {c: RNG.random((80, 70)).astype(np.float32) for c in "RGB"}
    if parts == 1:
        write(tmp_path / "f.exr", big)
    else:
        write_parts(tmp_path / "f.exr", {f"ViewLayer.{p}": big for p in ("Combined", "DiffCol", "Normal")})
    data = (tmp_path / "f.exr").read_bytes()
    (tmp_path / "f.exr").write_bytes(data[: int(keep * len(data))])
    with pytest.raises(InputError, match=r"f\.exr"):
        ExrSequence(tmp_path, fps=10)


def test_wrong_paths_and_layouts(tmp_path):
    with pytest.raises(InputError, match=r"nowhere: no such file or folder"):
        ExrSequence(tmp_path / "nowhere", fps=10)
    write(tmp_path / "f.exr", {"Q": plane()})
    with pytest.raises(InputError, match=r"no radiance .* channels Q"):
        ExrSequence(tmp_path, fps=10)
    write(tmp_path / "f.exr", rgb())
    with pytest.raises(InputError, match="carries no time"):
        ExrSequence(tmp_path)
    with pytest.raises(InputError, match="fps must be a positive number, got 0"):
        ExrSequence(tmp_path, fps=0)
    (tmp_path / "f.exr").write_text("not an image")
    with pytest.raises(InputError, match=r"cannot read .*f\.exr as EXR: Unable"):
        ExrSequence(tmp_path, fps=10)


def test_ambiguous_layers_are_named(tmp_path):
    channels = {f"{layer}.Combined.{c}": plane() for layer in ("near", "far") for c in "RGB"}
    write(tmp_path / "f.exr", channels)
    with pytest.raises(InputError, match="more than one view layer: far, near"):
        ExrSequence(tmp_path, fps=10)


def test_ambiguous_layers_of_parts_are_named(tmp_path):
    write_parts(
        tmp_path / "f.exr", {f"{n}.Combined": {f"Combined.{c}": plane() for c in "RGB"} for n in ("far", "near")}
    )
    with pytest.raises(InputError, match="more than one view layer: far, near"):
        ExrSequence(tmp_path, fps=10)


def test_writer_refuses_a_folder_that_holds_frames_and_leaves_nothing_half_written(tmp_path):
    writer = ExrWriter(tmp_path)
    frame = Frame(np.ones((3, H, W), np.float32), ("R", "G", "B"))
    writer.write(frame)
    with pytest.raises(InputError, match=r"holds EXR files already, such as frame_0000\.exr"):
        ExrWriter(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make the folder"):
        ExrWriter(tmp_path / "file" / "deeper")
    (tmp_path / "frame_0001.exr").mkdir()
    frame.index = 1
    with pytest.raises(InputError, match=r"cannot write .*frame_0001\.exr"):
        writer.write(frame)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "frame_0000.exr", "frame_0001.exr"]


def test_fill_writes_into_the_given_memory(tmp_path):
    write(tmp_path / "f.exr", rgb(3.0))
    source = ExrSequence(tmp_path, fps=10)
    out = Frame(np.zeros((3, H, W), np.float32), ("R", "G", "B"))
    memory = out.planes
    source.fill(0, out)
    assert out.planes is memory and (memory == 3).all()
    with pytest.raises(ValueError, match="expected"):
        source.fill(0, Frame(np.zeros((1, H, W), np.float32), ("R",)))
    source.close()
    source.close()


@pytest.mark.filterwarnings("error")
def test_positions_beside_the_camera_do_not_hide_in_which_space_they_are(tmp_path):
    """A hit at z = 0 has no direction through the picture: a wide lens has such, and pixels that meet an edge."""
    position, depth = pbrt_positions("camera", np.eye(4))
    position[:, 3, :2] = [[1.0, 2.0], [1.0, -1.0], [0.0, 0.0]]
    channels = {name: plane() for name in ("R", "G", "B", "dzdx")}
    write(tmp_path / "f.exr", channels | {f"P.{axis}": p for axis, p in zip("XYZ", position, strict=True)})
    _, frame = read_one(tmp_path / "f.exr")
    assert frame.plane("Depth")[3, :2] == pytest.approx([np.sqrt(2), np.sqrt(5)], rel=1e-4)
    np.testing.assert_allclose(frame.plane("Depth")[4:], depth[4:], rtol=1e-4)
