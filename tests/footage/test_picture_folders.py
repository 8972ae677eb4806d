"""Folders of pictures as people have them: with gaps, turned by EXIF, of one file; and interlaced video."""

import av
import numpy as np
import PIL.Image
import PIL.ImageOps
import pytest

from clsim.errors import InputError
from clsim.footage.images import Pictures, picture_files
from clsim.footage.source import Reading
from clsim.footage.transfer import decode
from clsim.footage.video import Video
from clsim.frames import RADIANCE, Frame

AT_100 = Reading(fps=100.0)


def pictures(folder, names):
    for name in names:
        PIL.Image.fromarray(np.full((6, 8, 3), 90, np.uint8)).save(folder / name)
    return Pictures(folder, AT_100)


@pytest.mark.parametrize(
    ("numbers", "leap"),
    [
        ((0, 1, 2, 5, 6), "its numbers leap from 2 to 5"),
        ((10, 20, 30, 50, 60), "its numbers leap from 30 to 50"),
        ((0, 1, 2, 3), None),
        ((0, 10, 20), None),
        ((0, 33, 67, 100, 133, 167, 200), None),
        ((3, 4, 18, 40, 90), None),
        ((7,), "is taken as one picture"),
    ],
)
def test_missing_numbers_are_told(tmp_path, numbers, leap):
    found = pictures(tmp_path, [f"f_{number:04d}.png" for number in numbers])
    assert found.warnings == () if leap is None else leap in found.warnings[0]
    assert found.frame_count == len(numbers)
    if len(numbers) > 1:
        assert Pictures(tmp_path, Reading(times_us=tuple(range(len(numbers))))).warnings == ()


def test_names_that_count_anew_are_no_leap(tmp_path):
    names = [f"{minute}_{second}.png" for minute in (1, 2) for second in (7, 8, 9, 5 + minute)]
    assert pictures(tmp_path, sorted(set(names))).warnings == ()


def test_one_picture_is_told_to_be_one(tmp_path):
    pages = [PIL.Image.fromarray(np.full((6, 8), 50 + 9 * k, np.uint8)) for k in range(4)]
    pages[0].save(tmp_path / "stack.tif", save_all=True, append_images=pages[1:])
    (warning,) = Pictures(tmp_path / "stack.tif", AT_100).warnings
    assert warning.endswith("stack.tif is taken as one picture, and nothing changes in it; expected a file for each")


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_pictures_lie_as_exif_says(tmp_path, orientation):
    exif = PIL.Image.Exif()
    exif[0x112] = orientation
    values = np.zeros((16, 24, 3), np.uint8)
    values[:8, :8], values[8:, :8], values[:8, 16:] = (250, 10, 10), (10, 250, 10), (200, 200, 200)
    for k in range(2):
        PIL.Image.fromarray(values).save(tmp_path / f"{k}.jpg", exif=exif, quality=100, subsampling=0)
    found = Pictures(tmp_path, AT_100)
    upright = np.array(PIL.ImageOps.exif_transpose(PIL.Image.open(tmp_path / "0.jpg")))
    assert (found.height, found.width) == upright.shape[:2]
    frame = Frame(np.zeros((3, found.height, found.width), np.float32), RADIANCE, 0)
    found.fill(0, frame)
    light = np.moveaxis(upright, 2, 0) / np.float32(255)
    decode(light, "srgb")
    np.testing.assert_allclose(frame.planes, light, atol=0.03)


@pytest.mark.parametrize("interlaced", [False, True])
def test_interlaced_video_is_told(tmp_path, interlaced):
    path = str(tmp_path / "a.mkv")
    with av.open(path, "w") as out:
        stream = out.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.options = {"flags": "+ildct+ilme"} if interlaced else {}
        for k in range(3):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(np.full((48, 64, 3), 40 * k, np.uint8), format="rgb24")))
        out.mux(stream.encode(None))
    video = Video(path)
    assert any("is interlaced" in warning for warning in video.warnings) is interlaced
    video.close()


@pytest.mark.parametrize(
    ("names", "pattern", "kinds"),
    [
        (["depth_{}.png", "rgba_{}.png"], "*.png", "several kinds: .*depth_.*, .*rgba_"),
        (["-{}.png", "{}.png"], "*.png", "several kinds"),
        (["cam0/{}.png", "cam1/{}.png"], "*/*.png", "holds 2 films whose pictures are counted alike"),
        (["left/{}.png", "right/{}.png"], "*/*.png", "several kinds: .*left.*, .*right"),
    ],
)
def test_a_pattern_that_matches_several_films_is_refused(tmp_path, names, pattern, kinds):
    for name in names:
        for k in range(3):
            path = tmp_path / name.format(f"{k + 1:04d}")
            path.parent.mkdir(exist_ok=True)
            PIL.Image.fromarray(np.full((6, 8), 50 + 9 * k, np.uint8)).save(path)
    with pytest.raises(InputError, match=kinds):
        Pictures(tmp_path / pattern, AT_100)


def test_a_folder_for_each_picture_is_ordered_by_its_number(tmp_path):
    for k in (10, 2, 1, 30, 3, 1002):
        (tmp_path / f"frame{k}").mkdir()
        PIL.Image.fromarray(np.full((6, 8), 7, np.uint8)).save(tmp_path / f"frame{k}" / "image.png")
    assert [file.parent.name for file in picture_files(tmp_path / "*" / "image.png")] == [
        f"frame{k}" for k in (1, 2, 3, 10, 30, 1002)
    ]
