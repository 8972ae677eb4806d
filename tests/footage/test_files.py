"""Files of footage as people have them: cut, of floating point, several films in one folder."""

import re
import warnings
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt
import pytest
import tifffile
from av.stream import Disposition
from PIL import Image

from clsim.errors import InputError
from clsim.footage.displacement import Displacement
from clsim.footage.images import Pictures
from clsim.footage.open import is_footage, open_footage
from clsim.footage.source import Footage, Reading
from clsim.footage.video import Video
from clsim.footage.wholeness import cut_end
from clsim.frames import RADIANCE, Frame, SourceEnded, page_aligned
from tests.footage.clips import write_clip

CASES = Path(__file__).parents[3] / "shared" / "cases"
WIDTH, HEIGHT, COUNT = 64, 48, 40


def read(source: Footage) -> list[npt.NDArray[np.float32]]:
    frames = []
    try:
        while True:
            frame = Frame(page_aligned((3, source.height, source.width)), RADIANCE)
            source.fill(len(frames), frame)
            frames.append(frame.planes)
    except SourceEnded:
        return frames


def picture(k: int) -> npt.NDArray[np.uint8]:
    return np.random.default_rng(k).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def film(path: Path, codec: str, pixels: str = "yuv420p", audio_s: float = 0.0, **options: str) -> Path:
    with av.open(str(path), "w", options=options) as container:
        stream: Any = container.add_stream(codec, rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        sound: Any = container.add_stream("aac", rate=48_000) if audio_s else None
        for k in range(COUNT):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(k), "rgb24")))
        container.mux(stream.encode())
        for k in range(int(audio_s * 48_000) // 1024):
            frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
            frame.rate, frame.pts = 48_000, 1024 * k
            container.mux(sound.encode(frame))
        if sound is not None:
            container.mux(sound.encode())
    return path


FILMS: dict[str, dict[str, Any]] = {
    "a.mkv": {"codec": "mpeg4"},
    "sound.mkv": {"codec": "mpeg4", "audio_s": 3.0},
    "short.mkv": {"codec": "mpeg4", "audio_s": 0.5},
    "a.mp4": {"codec": "mpeg4", "movflags": "faststart"},
    "sound.mp4": {"codec": "mpeg4", "audio_s": 3.0, "movflags": "faststart"},
    "parts.mp4": {"codec": "mpeg4", "movflags": "frag_keyframe+empty_moov"},
    "a.flv": {"codec": "flv1"},
    "a.ts": {"codec": "mpeg2video"},
    "a.avi": {"codec": "mjpeg", "pixels": "yuvj420p"},
    "a.gif": {"codec": "gif", "pixels": "rgb8"},
    "a.apng": {"codec": "apng", "pixels": "rgb24"},
}


@pytest.mark.parametrize("name", FILMS)
def test_a_whole_video_is_whole_and_a_cut_one_is_told(tmp_path: Path, name: str) -> None:
    path = film(tmp_path / name, **FILMS[name])
    assert len(read(Video(path, Reading(transfer="srgb")))) == COUNT
    data = path.read_bytes()
    (tmp_path / f"cut_{name}").write_bytes(data[: 6 * len(data) // 10 | 1])
    with pytest.raises(InputError, match=r"frames are missing|without its end mark|cannot be decoded|lacks \d+"):
        read(Video(tmp_path / f"cut_{name}", Reading(transfer="srgb", fps=1.0)))  # whatever rate is given


def test_a_gif_ends_with_its_mark_and_not_with_one_in_a_comment(tmp_path: Path) -> None:
    data = film(tmp_path / "a.gif", **FILMS["a.gif"]).read_bytes()
    assert data[-1:] == b";"
    comment = b"!\xfe\x14;;;;" + b"x" * 16 + b"\0"
    (tmp_path / "whole.gif").write_bytes(data[:-1] + comment + b";\0\0")
    assert len(read(Video(tmp_path / "whole.gif", Reading(transfer="srgb")))) == COUNT
    (tmp_path / "cut.gif").write_bytes(data[:-1] + comment)
    with pytest.raises(InputError, match="without its end mark"):
        read(Video(tmp_path / "cut.gif", Reading(transfer="srgb")))


@pytest.mark.parametrize("name", ["parts.mp4", "a.ts"])
def test_what_a_container_tells_of_its_end(tmp_path: Path, name: str) -> None:
    """Boxes tell their length, and packets have one; wherever else a file is cut than between them."""
    path = film(tmp_path / name, **(FILMS[name]))
    data, kind = path.read_bytes(), "mov,mp4" if name == "parts.mp4" else "mpegts"
    assert cut_end(str(path), kind) is None
    for size in np.random.default_rng(0).integers(len(data) // 2, len(data), 40).tolist():
        path.write_bytes(data[:size])
        told = cut_end(str(path), kind)
        if name == "a.ts":
            assert (told is None) == (size % 188 == 0)
        else:
            assert told is not None and re.match(r"lacks \d+ of|ends within the head", told)


@pytest.mark.parametrize("lead", [b"", b"time"], ids=["alone", "after a time, as camcorders write them"])
def test_a_last_frame_that_is_not_whole_is_told(tmp_path: Path, lead: bytes) -> None:
    """Where a transport stream tells how long a frame is, whole packets of it may be missing."""
    head = bytes([0x47, 0x41, 0x00, 0x10]) + b"\0\0\1\xe0" + (500).to_bytes(2, "big")
    stuffed = bytes([0x47, 0x01, 0x00, 0x31, 9]) + bytes(183)  # ten bytes of which are no payload
    packets = [head + bytes(188 - len(head)), stuffed, bytes([0x47, 0x01, 0x00, 0x12]) + bytes(184)]
    for count, missing in ((1, 500 + 6 - 184), (2, 500 + 6 - 184 - 174), (3, None)):
        all_ = [bytes([0x47, 0x1F, 0xFF, 0x10]) + bytes(184)] * 3 + packets[:count]
        (tmp_path / "a.ts").write_bytes(b"".join(lead + packet for packet in all_))
        expected = None if missing is None else f"lacks {missing} bytes of its last frame"
        assert cut_end(str(tmp_path / "a.ts"), "mpegts") == expected


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not beside the checkout")
def test_the_shared_cut_video_tells_how_much_is_missing() -> None:
    with pytest.raises(InputError, match=r"ends at 0\.363 s, but its header tells 0\.627 s: some 8 frames are missing"):
        read(Video(CASES / "trunc.mkv"))


def test_a_gif_is_srgb_as_its_pictures_are(tmp_path: Path) -> None:
    codes = np.tile(np.arange(0, 256, 4, dtype=np.uint8), (HEIGHT, 1))
    images = [Image.fromarray(np.roll(codes, 8 * k, axis=1)) for k in range(3)]
    images[0].save(tmp_path / "a.gif", save_all=True, append_images=images[1:], duration=100)
    (tmp_path / "pictures").mkdir()
    for k, image in enumerate(images):
        image.save(tmp_path / "pictures" / f"{k}.png")
    gif = Video(tmp_path / "a.gif")
    assert gif.transfer == "srgb" and gif.warnings == ()
    for ours, expected in zip(read(gif), read(Pictures(tmp_path / "pictures", Reading(fps=10.0))), strict=True):
        assert np.allclose(ours, expected, atol=1e-6)


LIGHT = np.random.default_rng(3).uniform(0, 2, (HEIGHT, WIDTH, 3)).astype(np.float16)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}, {"planarconfig": "separate"}], ids=str)
def test_tiff_of_floating_point_is_light_as_it_stands(
    tmp_path: Path, kind: type, channels: int, options: dict[str, Any]
) -> None:
    """Of two channels or four the last is opacity."""
    grey, opacity = channels < 3, np.full((HEIGHT, WIDTH, 1), 0.3)
    planes = np.concatenate([LIGHT[..., : 1 if grey else 3], opacity], axis=2).astype(kind)
    pixels = planes[..., 0] if channels == 1 else planes[..., :channels]
    if options.get("planarconfig"):
        if channels == 1:
            return
        pixels = np.moveaxis(pixels, 2, 0)
    more: dict[str, Any] = {} if channels == 1 else {"photometric": "minisblack" if grey else "rgb"}
    more |= {"planarconfig": "contig"} if channels == 2 and not options.get("planarconfig") else {}
    tifffile.imwrite(tmp_path / "a0.tif", pixels, **options, **more)
    source = Pictures(tmp_path, Reading(fps=10.0))
    assert source.transfer == "linear" and source.steps is None
    (found,) = read(source)
    expected = LIGHT[..., :1].repeat(3, axis=2) if grey else LIGHT
    assert np.array_equal(found, np.moveaxis(expected, 2, 0).astype(np.float32))


def test_tiff_of_whole_numbers_is_srgb_and_a_damaged_one_is_refused(tmp_path: Path) -> None:
    Image.fromarray(picture(0)).save(tmp_path / "a0.tif")
    assert Pictures(tmp_path, Reading(fps=10.0)).transfer == "srgb"
    tifffile.imwrite(tmp_path / "a0.tif", LIGHT)
    data = (tmp_path / "a0.tif").read_bytes()
    for size in (10, 200, len(data) // 2):
        (tmp_path / "a0.tif").write_bytes(data[:size])
        with pytest.raises(InputError, match=r"a0\.tif: cannot be decoded"):
            read(Pictures(tmp_path, Reading(fps=10.0)))


@pytest.mark.parametrize("ending", ["png", "jpg", "tif", "bmp", "webp", "ppm"])
def test_a_picture_that_was_cut_is_refused(tmp_path: Path, ending: str) -> None:
    """Also one whose preview, inside it, is whole."""
    thumbnail = Image.Exif()
    thumbnail[0x9286] = b"\xff\xd8\xff\xda\0\xff\xd9"
    more = {"exif": thumbnail} if ending == "jpg" else {}
    Image.fromarray(picture(0)).save(tmp_path / f"a0.{ending}", **more)
    assert len(read(Pictures(tmp_path, Reading(fps=10.0)))) == 1
    data = (tmp_path / f"a0.{ending}").read_bytes()
    (tmp_path / f"a0.{ending}").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"cannot be decoded|ends in the middle of its picture"):
        read(Pictures(tmp_path, Reading(fps=10.0)))


@pytest.mark.parametrize("other", [np.zeros((4, 6), np.uint16), np.zeros((6, 4), np.uint8)])
def test_a_picture_of_another_size_or_depth_than_the_first_is_refused(tmp_path: Path, other: Any) -> None:
    """Steps of light that count as noise are those of the first's depth."""
    Image.fromarray(np.zeros((4, 6), np.uint8)).save(tmp_path / "a0.png")
    Image.fromarray(other).save(tmp_path / "a1.png")
    with pytest.raises(InputError, match=r"a1\.png: has .* pixels as gray.*, expected 6×4 as gray of a0\.png"):
        read(Pictures(tmp_path, Reading(fps=10.0)))


def folder(path: Path, *names: str) -> Path:
    path.mkdir()
    for name in names:
        Image.fromarray(picture(0)).save(path / name)
    return path


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["rgba_01.png", "rgba_02.png", "segmentation_01.png"], r"several kinds: rgba_\*\.png, segmentation_\*\.png"),
        (["a_1.png", "a_2.png", "a_1.bmp", "a_2.bmp"], "several kinds"),
        (["0001.png", "0002.png", "preview.png"], r"several kinds: \*\.png, preview\.png"),
        (["cam0_01.png", "cam0_02.png", "cam1_01.png", "cam1_02.png"], r"holds 2 films .* 'folder/cam0_\*\.png'"),
    ],
)  # fmt: skip
def test_a_folder_of_several_films_is_refused_and_a_pattern_chooses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    place = folder(Path("folder"), *names)
    with pytest.raises(InputError, match=message):
        Pictures(place, Reading(fps=10.0))
    pattern = names[0].rsplit(names[0].rsplit(".", 1)[0][-1], 1)[0] + "*." + names[0].rsplit(".", 1)[1]
    assert 2 <= len(read(Pictures(place / pattern, Reading(fps=10.0)))) <= 3


@pytest.mark.parametrize("pattern", ["", "/*"])
def test_pictures_beside_exr_frames_are_no_footage(tmp_path: Path, pattern: str) -> None:
    place = folder(tmp_path / "folder", "preview.png")
    assert is_footage(f"{place}{pattern}")
    (place / "frame-000000.exr").touch()
    assert not is_footage(f"{place}{pattern}")


@pytest.mark.parametrize(
    "names",
    [
        ["frame_1.png", "frame_2.png", "frame_10.png"],
        ["12_59.png", "13_59.png"],
        ["12_59_58.png", "12_59_59.png", "13_00_00.png", "13_00_01.png"],
        ["1690000000.123456.png", "1690000000.623456.png", "1690000001.123456.png"],
        ["a.png", "b.png", "c.png"],
        ["shot2_0001.png", "shot2_0002.png"],
    ],
)
def test_one_film_is_taken_as_one(tmp_path: Path, names: list[str]) -> None:
    place = folder(tmp_path / "folder", *names)
    for pattern in (str(place), f"{place}/*"):
        assert open_footage(pattern, Reading(fps=10.0)).frame_count == len(names)


def test_times_that_repeat_name_the_options_that_help(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt, stream.time_base = WIDTH, HEIGHT, "bgr0", Fraction(1, 1000)
        for k, pts in enumerate((0, 40, 40, 80)):
            frame = av.VideoFrame.from_ndarray(picture(k), "rgb24")
            frame.pts, frame.time_base = k, Fraction(1, 1000)
            for packet in stream.encode(frame):
                packet.pts = packet.dts = pts
                packet.time_base = Fraction(1, 1000)
                container.mux(packet)
    with pytest.raises(InputError, match="later than 40000 µs of the one before; `fps` or `times` replace the file's"):
        read(Video(path))
    assert len(read(Video(path, Reading(fps=25.0)))) == 4


def test_pictures_without_texture_or_numbers_are_measured_without_a_warning() -> None:
    flat = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    texture = np.random.default_rng(0).uniform(0.1, 1, (HEIGHT, WIDTH)).astype(np.float32)
    wild = np.roll(texture, 2, axis=1)
    wild[3, 4], wild[5, 40], wild[7, 8] = np.nan, np.nan, np.inf
    measured = Displacement(WIDTH, HEIGHT)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shifts = [measured.add(frame) for frame in (flat, flat, texture, wild, flat)]
        assert shifts[:3] == [None, None, None] and shifts[4] is None
        assert shifts[3] == pytest.approx(2, abs=0.3)
        # A block that is found again where nothing is.
        blocks = texture[None, :32, :32] - texture[:32, :32].mean()
        _, alike = measured._rest(blocks, np.zeros_like(blocks))
    assert alike.tolist() == [0]


@pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not beside the checkout")
def test_the_shared_pictures_with_little_texture_are_read_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read(Pictures(CASES / "flat", Reading(fps=30.0)))) == 4


@pytest.mark.parametrize("name", [".hidden.png", "._00001.png"])
def test_hidden_files_and_others_in_a_folder_are_no_pictures_of_its_film(tmp_path: Path, name: str) -> None:
    """Such as those that macOS leaves beside each file, of the same ending and no picture."""
    for k in range(3):
        Image.fromarray(picture(k)).save(tmp_path / f"{k:05d}.PNG")
    (tmp_path / name).write_bytes(b"\0\5\x16\7")
    (tmp_path / "notes.txt").write_text("of these pictures")
    assert len(read(Pictures(tmp_path, Reading(fps=25.0)))) == 3


def test_a_png_is_srgb_also_where_it_tells_of_a_video_s_curve(tmp_path: Path) -> None:
    """Its decoder guesses, except of HDR."""
    for number, (told, expected) in enumerate(((1, "srgb"), (13, "srgb"), (16, "pq"))):
        place = tmp_path / str(number)
        place.mkdir()
        write_clip(place / "a.png", [np.zeros((4, 6, 3), np.uint8)], [0], pixels="rgb24", codec="png", trc=told)
        assert Pictures(place, Reading(fps=10.0)).transfer == expected


@pytest.mark.parametrize("long", [(False, False), (True, False), (False, True), (True, True)])
def test_boxes_tell_their_length_in_32_bits_or_in_64(tmp_path: Path, long: tuple[bool, bool]) -> None:
    """ISO/IEC 14496-12: where the size is 1, the true one follows in 64 bits; films above 4 GB have such."""
    boxes = []
    for kind, wide, body in zip((b"mdat", b"moov"), long, (bytes(300), bytes(40)), strict=True):
        length = len(body) + (16 if wide else 8)
        head = (1).to_bytes(4, "big") + kind + length.to_bytes(8, "big") if wide else length.to_bytes(4, "big") + kind
        boxes.append(head + body)
    path = tmp_path / "a.mp4"
    path.write_bytes(b"".join(boxes))
    assert cut_end(str(path), "mov,mp4") is None
    path.write_bytes(b"".join(boxes)[:-3])
    assert cut_end(str(path), "mov,mp4") == f"lacks 3 of the {len(boxes[1])} bytes of its last box (moov)"
    path.write_bytes(boxes[0][:-7])
    assert cut_end(str(path), "mov,mp4") == f"lacks 7 of the {len(boxes[0])} bytes of its last box (mdat)"


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_file_of_several_films_tells_that_the_first_is_read(tmp_path: Path, count: int) -> None:
    """Stereo cameras write such; a cover is no film."""
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        streams: list[Any] = [container.add_stream(codec, rate=Fraction(30)) for codec in ["mpeg4"] * count + ["mjpeg"]]
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        streams[-1].pix_fmt, streams[-1].disposition = "yuvj420p", Disposition.attached_pic
        for k, stream in enumerate(streams):
            for _ in range(1 if stream is streams[-1] else 3):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(k), "rgb24")))
            container.mux(stream.encode())
    told = [text for text in Video(tmp_path / "a.mp4").warnings if " films," in text]
    assert told == ([] if count == 1 else [f"{tmp_path / 'a.mp4'} holds {count} films, of which the first is read"])


@pytest.mark.parametrize("name", ["a.mp4", "a.avi"])
def test_a_video_with_a_frame_that_is_damaged_tells_it(tmp_path: Path, name: str) -> None:
    """libav makes up what it cannot decode."""
    path = film(tmp_path / name, "mpeg4")
    assert len(read(Video(path, Reading("srgb")))) == COUNT
    with av.open(str(path)) as container:
        places = [packet.pos for packet in container.demux(video=0) if packet.size]
    data = bytearray(path.read_bytes())
    for place in (places[12], places[20]):
        data[place + 200 : place + 240] = bytes(byte ^ 0x55 for byte in data[place + 200 : place + 240])
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"frame 12 is damaged, and what follows may be too; expected a whole video"):
        read(Video(path, Reading("srgb")))


def test_an_flv_whose_frames_refer_to_later_ones_is_whole(tmp_path: Path) -> None:
    """Its header counts from the first frame that is decoded, which is not the first that is shown."""
    for count in ("0", "2"):
        with av.open(str(tmp_path / "a.flv"), "w") as container:
            stream: Any = container.add_stream("libx264", rate=Fraction(30), options={"bf": count})
            stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
            for k in range(COUNT):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(k % 2), "rgb24")))
            container.mux(stream.encode())
        assert len(read(Video(tmp_path / "a.flv", Reading("srgb")))) == COUNT


def test_a_video_in_a_codec_that_nobody_knows_is_refused_in_a_sentence(tmp_path: Path) -> None:
    data = film(tmp_path / "a.avi", "mpeg4").read_bytes()
    assert data.count(b"FMP4") == 2  # in the heads of the stream and of its format
    (tmp_path / "b.avi").write_bytes(data.replace(b"FMP4", b"ZZZ9"))
    with pytest.raises(InputError, match=r"b\.avi: cannot be decoded \(its codec is not known\)"):
        Video(tmp_path / "b.avi")


@pytest.mark.parametrize(("aspect", "told"), [(None, False), (Fraction(1), False), (Fraction(4, 3), True)])
def test_pixels_that_are_not_square_are_told(tmp_path: Path, aspect: Fraction | None, told: bool) -> None:
    """HDV stores 1440 columns for 1920; an event camera sees no squeezed world."""
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream: Any = container.add_stream("libx264", rate=Fraction(30))
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(0), "rgb24")))
        container.mux(stream.encode())
    sentence = f"{tmp_path / 'a.mkv'} has pixels of 4:3, and is taken as stored: squeeze or stretch it first"
    assert (sentence in Video(tmp_path / "a.mkv").warnings) == told
    assert len(Video(tmp_path / "a.mkv").warnings) == 1 + told
