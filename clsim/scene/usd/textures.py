"""Textures of UsdPreviewSurface: pictures, what their numbers are multiplied by, and how they lie on a surface."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdShade

from clsim.errors import InputError
from clsim.scene.pictures.images import (
    U8,
    PixelBudget,
    decode_rgba,
    decode_srgb,
    encode_srgb8,
    is_linear,
    read_light,
    read_texture,
)
from clsim.scene.usd.stage import Stage
from clsim.scene.world import ImageTexture, Texture, Vec3, Wrap

_WRAPS: dict[str, Wrap] = {"clamp": "clamp", "black": "clamp", "constant": "clamp", "mirror": "mirror"}
PICTURES = ("UsdUVTexture", "ND_UsdUVTexture", "ND_image_", "ND_tiledimage_")
PRIMVARS = ("UsdPrimvarReader_float3", "UsdPrimvarReader_vector", "ND_geompropvalue_color3", "ND_geomcolor_color3")
"""Nodes whose values are those of a mesh, where a colour is asked for."""
PASSING = {"ND_normalmap": "in", "ND_constant_": "value", "ND_dot_": "in", "ND_convert_": "in"}
"""Nodes of MaterialX that pass an input on, as far as clsim goes."""
MOST_NODES = 8
"""How far a graph is followed; it may run in circles."""
_PNG = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {"r": 0, "g": 1, "b": 2, "a": 3}
F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Told:
    """What an input of a shader is: a value, or a picture.

    Attributes:
        value: what is told where there is no picture; None where nothing is told.
        attribute: where that value stands.
        image: the picture, encoded as it came.
        key: what makes it the same picture.
        channel: which of its channels, 0 … 3, where the input takes a number.
        scale, bias: what its channels are multiplied by, and what is then added.
        primvar: which values of the mesh it is, where it is neither.
    """

    value: Any = None
    attribute: Any = None
    image: ImageTexture | None = None
    key: tuple[Any, ...] = ()
    channel: int = 0
    scale: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    primvar: str = ""
    bias: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)

    def color(self, default: Vec3) -> Vec3:
        """Return the value as a colour."""
        found = np.ravel(np.array(default if self.value is None else self.value, np.float64))
        r, g, b = np.nan_to_num(np.resize(found, 3)).tolist() if len(found) in (1, 3) else default
        return r, g, b

    def number(self, default: float) -> float:
        """Return the value as a number."""
        found = float(self.value) if isinstance(self.value, int | float) else default
        return found if math.isfinite(found) else default

    def plain(self, channel: int) -> F64:
        """Return the numbers that a channel of the picture stands for ``[h, w]``, 0 … 1."""
        if self.image is None:
            return np.zeros((1, 1))
        values: F64 = self.image.pixels[..., channel] / 255.0
        if self.image.srgb and channel < 3:
            values = decode_srgb(values)
        return np.clip(values * self.scale[channel] + self.bias[channel], 0.0, 1.0)


class TextureReader:
    """Reads what inputs of shaders are, each picture once.

    Attributes:
        textures: what materials use.
    """

    def __init__(self, stage: Stage, warn: Callable[[str], None]) -> None:
        """Read from a stage; ``warn`` takes what cannot be used."""
        self.textures: list[Texture] = []
        self._stage, self._warn = stage, warn
        self._budget = PixelBudget()
        self._pixels: dict[str, U8 | None] = {}
        self._indices: dict[tuple[Any, ...], int] = {}

    def told(self, shader: Any, name: str, depth: int = 0, *, followed: bool = False) -> Told:
        """Return what an input is, through all connections; ``followed`` is what may change with time."""
        source = shader.GetInput(name)
        for attribute in source.GetValueProducingAttributes() if source else []:
            if not UsdShade.Output.IsOutput(attribute):
                value = self._stage.value(attribute) if followed else self._stage.still(attribute)
                return Told(value, attribute)
            node, output = UsdShade.Shader(attribute.GetPrim()), attribute.GetName().rpartition(":")[2]
            kind = str(node.GetIdAttr().Get()) if node else "a graph"
            if kind.startswith(PICTURES):
                return self._texture(node, output)
            if kind.startswith(PRIMVARS):
                return Told((1.0, 1.0, 1.0), primvar=self._primvar(node, kind))
            passed = next((entry for prefix, entry in PASSING.items() if kind.startswith(prefix)), None)
            if passed is not None and depth < MOST_NODES:
                return self.told(node, passed, depth + 1, followed=followed)
            self._warn(f"what {kind} gives to materials is left out (first {name} of {shader.GetPath()})")
        return Told()

    def uv_names(self, shader: Any) -> list[str]:
        """Return which primvars the pictures of a surface take for texture coordinates."""
        names = []
        for source in shader.GetInputs():
            for attribute in source.GetValueProducingAttributes():
                texture = UsdShade.Shader(attribute.GetPrim())
                if UsdShade.Output.IsOutput(attribute) and str(texture.GetIdAttr().Get()).startswith(PICTURES):
                    names.append(self._reader(texture)[0])
        return names

    def primvar_name(self, shader: Any, name: str) -> str | None:
        """Return which primvar an input is; None where it is none."""
        source = shader.GetInput(name)
        for attribute in source.GetValueProducingAttributes() if source else []:
            node = UsdShade.Shader(attribute.GetPrim())
            kind = str(node.GetIdAttr().Get()) if node else ""
            if UsdShade.Output.IsOutput(attribute) and kind.startswith(PRIMVARS):
                return self._primvar(node, kind)
        return None

    def _primvar(self, node: Any, kind: str) -> str:
        if kind.startswith("ND_geomcolor"):
            return "displayColor"
        return str(self._value(node, "geomprop" if kind.startswith("ND_") else "varname") or "")

    def add(self, key: tuple[Any, ...], make: Callable[[], ImageTexture]) -> int:
        """Return the index of a texture, which is made where it is not there yet."""
        if key not in self._indices:
            self._indices[key] = len(self.textures)
            self.textures.append(make())
        return self._indices[key]

    def colors(self, told: Told, most: float = math.inf) -> tuple[int, Vec3]:
        """Return the index of a picture of colours, −1 for none, and what multiplies it, at most ``most``."""
        if told.image is None:
            return -1, (1.0, 1.0, 1.0)
        image = told.image
        if any(told.bias[:3]) or max(told.scale[:3]) > most:
            return self.add((*told.key, "biased", told.scale, told.bias), lambda: _biased(told, image)), (1.0, 1.0, 1.0)
        r, g, b = (max(factor, 0.0) for factor in told.scale[:3])
        return self.add(told.key, lambda: image), (r, g, b)

    def lights(self, told: Told) -> tuple[int, Vec3]:
        """Return what `colors` returns, for a picture of light, which may exceed 1."""
        if told.image is None or any(told.bias[:3]) or not is_linear(told.key[0]):
            return self.colors(told)
        pixels, most = read_light(Path(told.key[0]), self._budget)
        image = replace(told.image, pixels=pixels)
        index, (r, g, b) = self.colors(replace(told, image=image, key=(*told.key, "light")))
        return index, (r * most, g * most, b * most)

    def normals(self, told: Told) -> int:
        """Return the index of a normal map, −1 for none: bytes from 0 to 255 stand for −1 to 1, whoever says so.

        Scale and bias may say that they point the other way, as green does in DirectX's maps.
        """
        if told.image is None:
            return -1
        plain = replace(told.image, srgb=False)
        if is_linear(told.key[0]):
            plain = replace(plain, pixels=read_texture(Path(told.key[0]), self._budget, srgb=False))
        turned = [k for k in range(3) if told.scale[k] < 0 < told.bias[k]]
        if turned:
            pixels = plain.pixels.copy()
            pixels[..., turned] = 255 - pixels[..., turned]
            plain = replace(plain, pixels=pixels)
        return self.add((*told.key, "normal", *turned), lambda: plain)

    def _texture(self, shader: Any, output: str) -> Told:
        name = shader.GetPath()
        file = shader.GetInput("file")
        found = file.GetValueProducingAttributes() if file else []
        try:
            named = self._stage.picture(found[0]) if found else None
            pixels = None if named is None else self._decoded(*named)
        except InputError as error:
            self._warn(f"a texture is left out: {error}")
            pixels, named = None, None
        if pixels is None or named is None:
            fallback = self._value(shader, "default" if str(shader.GetIdAttr().Get()).startswith("ND_") else "fallback")
            if isinstance(fallback, float):
                return Told(fallback)
            if fallback is None:
                return Told(None)
            if output in ("rgb", "out"):
                return Told(tuple(fallback)[:3])
            channel = _CHANNELS.get(output, 0)
            return Told(fallback[channel] if channel < len(fallback) else 1.0)
        _, matrix = self._reader(shader)
        kind = str(shader.GetIdAttr().Get())
        space = str(self._value(shader, "sourceColorSpace") or "auto")
        if kind.startswith(("ND_image_", "ND_tiledimage_")):
            # MaterialX encodes colours alone, and says so at the file.
            told = str(found[0].GetColorSpace() or "")
            space = "raw" if "color" not in kind or "lin" in told or told == "raw" else "auto"
        srgb = _is_encoded(space, *named)
        names = ("uaddressmode", "vaddressmode") if kind.startswith("ND_") else ("wrapS", "wrapT")
        if any(str(self._value(shader, wrap)) in ("black", "constant") for wrap in names):
            self._warn(f"pictures that are black outside are as at their edge there (first {name})")
        wraps = [_WRAPS.get(str(self._value(shader, wrap)), "repeat") for wrap in names]
        image = ImageTexture(pixels, srgb=srgb, wrap_u=wraps[0], wrap_v=wraps[1], uv_matrix=matrix)
        scale, bias = (_four(self._value(shader, key), default) for key, default in (("scale", 1.0), ("bias", 0.0)))
        key = (str(named[1]) if isinstance(named[1], Path) else named[0], srgb, *wraps, matrix)
        if not np.isfinite([*scale, *bias]).all():
            raise InputError(f"{self._stage.path}: {name} has a scale or a bias that is not finite")
        return Told(image=image, key=key, channel=_CHANNELS.get(output, 0), scale=scale, bias=bias)

    def _decoded(self, name: str, file: Path | bytes) -> U8 | None:
        key = name if isinstance(file, bytes) else str(file)
        if key not in self._pixels:
            if "<UDIM>" in key:
                self._warn(f"textures in tiles are left out (first {name})")
                self._pixels[key] = None
            elif isinstance(file, bytes):
                self._pixels[key] = decode_rgba(f"{self._stage.path}[{name}]", file, self._budget)
            else:
                self._pixels[key] = read_texture(file, self._budget)
        return self._pixels[key]

    def _reader(self, shader: Any) -> tuple[str, tuple[Vec3, Vec3]]:
        """Return the primvar of texture coordinates, and the map that is applied to them."""
        matrix, seen = np.eye(3), 0
        while shader and seen < 8:  # a graph may run in circles
            kind, seen = str(shader.GetIdAttr().Get() or ""), seen + 1
            if kind.startswith("UsdPrimvarReader"):
                name = str(self._value(shader, "varname") or "st")
                break
            if kind == "UsdTransform2d":
                matrix = matrix @ self._transform(shader)
            if kind.startswith("ND_geompropvalue_vector2"):
                name = str(self._value(shader, "geomprop") or "st")
                break
            if kind.startswith("ND_tiledimage_"):
                tiling = self._value(shader, "uvtiling")
                matrix = matrix @ np.diag([*(tiling or (1.0, 1.0)), 1.0])
            following = shader.GetInput({"UsdUVTexture": "st"}.get(kind, "texcoord" if "image" in kind else "in"))
            attributes = following.GetValueProducingAttributes() if following else []
            shader = UsdShade.Shader(attributes[0].GetPrim()) if attributes else None
        else:
            name = "st"
        (a, b, c), (d, e, f) = matrix[:2].tolist()
        return name, ((a, b, c), (d, e, f))

    def _transform(self, shader: Any) -> F64:
        """Return UsdTransform2d as a matrix: scale, then turn, then shift."""
        turn = math.radians(float(self._value(shader, "rotation") or 0.0))
        given = (self._value(shader, "scale"), self._value(shader, "translation"))
        scale, shift = (
            tuple(each) if each is not None else rest for each, rest in zip(given, ((1, 1), (0, 0)), strict=True)
        )
        c, s = math.cos(turn), math.sin(turn)
        matrix = np.array([[c * scale[0], -s * scale[1], shift[0]], [s * scale[0], c * scale[1], shift[1]], [0, 0, 1]])
        return matrix if np.isfinite(matrix).all() else np.eye(3)

    def _value(self, shader: Any, name: str) -> Any:
        source = shader.GetInput(name)
        for attribute in source.GetValueProducingAttributes() if source else []:
            if not UsdShade.Output.IsOutput(attribute):
                return self._stage.still(attribute)
        return None


def _is_encoded(space: str, name: str, file: Path | bytes) -> bool:
    """Tell whether a picture, as we hold it, has sRGB's curve; ``auto`` is so for those of 8 bits with colours."""
    if is_linear(name):
        return True
    if space != "auto":
        return space == "sRGB"
    from PIL import Image

    with io.BytesIO(file) if isinstance(file, bytes) else file.open("rb") as data:
        head = data.read(len(_PNG) + 17)
    if head.startswith(_PNG) and head[24:25] == b"\x10":  # which Pillow rounds to 8 bits
        return False
    with Image.open(io.BytesIO(file) if isinstance(file, bytes) else file) as image:
        return image.mode in ("RGB", "RGBA", "P", "CMYK", "YCbCr")


def same_size(first: F64, second: F64) -> tuple[F64, F64]:
    """Return two pictures in the larger size of both, by the nearest pixels."""
    height, width = max(len(first), len(second)), max(first.shape[1], second.shape[1])

    def sized(picture: F64) -> F64:
        rows, columns = (np.arange(n) * old // n for n, old in zip((height, width), picture.shape, strict=True))
        larger: F64 = picture[rows[:, None], columns]
        return larger

    return sized(first), sized(second)


def _biased(told: Told, image: ImageTexture) -> ImageTexture:
    colors = np.stack([told.plain(channel) for channel in range(3)], axis=-1)
    pixels = np.concatenate([encode_srgb8(colors), image.pixels[..., 3:]], axis=2)
    return replace(image, pixels=np.ascontiguousarray(pixels), srgb=True)


def _four(value: Any, default: float) -> tuple[float, ...]:
    return (default,) * 4 if value is None else tuple(float(each) for each in value)
