"""An open USD file: its units, its axes, its time, and the files that it names."""

from __future__ import annotations

import itertools
import re
import textwrap
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Ar, Sdf, Tf, Usd, UsdGeom, UsdSkel, UsdUtils

from clsim.errors import InputError
from clsim.scene.files import named_file
from clsim.scene.motion import Matrix
from clsim.scene.usd.bounds import check_bounds

MAX_BYTES = 1 << 30
"""Largest picture within a package, and most that shapes which change, and places of copies, may take in all."""


class PrimError(InputError):
    """What is wrong with one prim, without which the others can be shown."""


_HARMLESS = "MaterialBindingAPI is not applied"
"""What changes nothing: the material is found all the same."""


class Stage:
    """A stage, with all that is needed to bring it into our world.

    Attributes:
        path: its file.
        warn: takes what is left out.
        usd: the stage of usd-core.
        root: 4×4 matrix from its world to ours: metres, +y up.
        metres: length of its unit [m].
        start, end: time codes at which it begins and ends; equal where it has no length.
        codes_per_s: time codes per second.
    """

    def __init__(self, path: Path, warn: Callable[[str], None]) -> None:
        """Open a file with all that it refers to; ``warn`` takes what cannot be found or read.

        Raises:
            InputError: naming the file, if it is no USD, or takes too much to open.
        """
        self.path, self.warn = path, warn
        self._lacking: set[str] = set()
        collector = UsdUtils.CoalescingDiagnosticDelegate()
        try:
            layer = check_bounds(path)
            self.usd: Any = Usd.Stage.Open(layer or str(path))
        except Tf.ErrorException as error:
            raise InputError(f"{path}: cannot be read as USD ({_reason(error)})") from None
        finally:
            complaints = [each.commentary for each in collector.TakeUncoalescedDiagnostics()]
        self._pass_on(complaints)
        self.metres: float = self._metadata("metersPerUnit", UsdGeom.GetStageMetersPerUnit)
        if not 1e-9 <= self.metres <= 1e9:
            raise InputError(f"{path}: metersPerUnit is {self.metres:g}, expected a positive number of metres")
        self.z_up = self._metadata("upAxis", UsdGeom.GetStageUpAxis, str) == UsdGeom.Tokens.z
        self.root: Matrix = np.diag([self.metres, self.metres, self.metres, 1.0])
        if self.z_up:
            self.root = self.root @ [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]
        self.codes_per_s: float = self._metadata("timeCodesPerSecond", Usd.Stage.GetTimeCodesPerSecond)
        self.start = self._metadata("startTimeCode", Usd.Stage.GetStartTimeCode)
        self.end = self._metadata("endTimeCode", Usd.Stage.GetEndTimeCode)
        if not (self.codes_per_s > 0 and np.isfinite([self.start, self.end, self.codes_per_s]).all()):
            told = f"time codes {self.start:g} to {self.end:g}, {self.codes_per_s:g} per second"
            raise InputError(f"{path}: has {told}, expected finite numbers, and more than 0 per second")
        self.end = max(self.start, self.end)
        if self.end == self.start and not self.usd.HasAuthoredTimeCodeRange():
            self.start, self.end = self._sampled()
        self._left = MAX_BYTES
        self._bake_skins()
        self._cache: Any = UsdGeom.XformCache()

    def _metadata(self, name: str, getter: Callable[[Any], Any], kind: Callable[[Any], Any] = float) -> Any:
        """Return what the file tells of itself, also where that is of another type, as float for double."""
        try:
            return kind(getter(self.usd))
        except Tf.ErrorException:
            found = self.usd.GetMetadata(name)
        try:
            return kind(found)
        except (TypeError, ValueError):
            raise InputError(f"{self.path}: {name} is {found!r}, expected another type") from None

    def _sampled(self) -> tuple[float, float]:
        """Return the first and the last time code of all samples, where a file tells no range of its own."""
        codes = [self.start]
        shared = (prim for prototype in self.usd.GetPrototypes() for prim in Usd.PrimRange(prototype))
        for prim in itertools.chain(self.usd.TraverseAll(), shared):
            for attribute in prim.GetAuthoredAttributes():
                with suppress(Tf.ErrorException):
                    sampled = attribute.GetTimeSamples() if attribute.ValueMightBeTimeVarying() else []
                    codes += [code for code in (*sampled[:1], *sampled[-1:]) if np.isfinite(code)]
        return (min(codes[1:]), max(codes)) if len(codes) > 1 else (self.start, self.start)

    @property
    def duration_s(self) -> float:
        """Length of its time [s]; 0 where it tells none."""
        return float((self.end - self.start) / self.codes_per_s)

    def seconds(self, code: float) -> float:
        """Return the time of a time code [s]."""
        return float((code - self.start) / self.codes_per_s)

    def to_world(self, prim: Any, code: float) -> Matrix:
        """Return the 4×4 matrix from a prim's space to our world at a time code."""
        if self._cache.GetTime() != Usd.TimeCode(code):
            self._cache.SetTime(Usd.TimeCode(code))
        # USD's vectors are rows, ours are columns.
        matrix: Matrix = self.root @ np.array(self._cache.GetLocalToWorldTransform(prim)).T
        if not np.isfinite(matrix.astype(np.float32)).all():
            raise PrimError(f"{self.path}: {prim.GetPath()} stands at a place that is not finite")
        return matrix

    def to_ancestor(self, prim: Any, ancestor: Any) -> Matrix:
        """Return the 4×4 matrix from a prim's space to that of an ancestor, at the start."""
        self._cache.SetTime(Usd.TimeCode(self.start))
        matrix, _ = self._cache.ComputeRelativeTransform(prim, ancestor)
        inner: Matrix = np.array(matrix).T
        return inner

    def value(self, attribute: Any, code: float | None = None) -> Any:
        """Return what an attribute is at a time code, by default at the start; None where it has no value."""
        if not attribute:
            return None
        try:
            return attribute.Get(self.start if code is None else code)
        except (Tf.ErrorException, TypeError) as error:
            raise PrimError(f"{self.path}: {attribute.GetPath()} cannot be read ({_reason(error)})") from None

    def still(self, attribute: Any) -> Any:
        """Return what `value` does at the start, of what is not followed; a warning tells where it changes."""
        found = self.value(attribute)
        if any(self.value(attribute, code) != found for code in self.times(attribute)):
            name, about = attribute.GetName().rpartition(":")[2], attribute.GetPrim().GetName()
            self.warn(f"{name} that changes with time is as at the start (first {about})")
        return found

    @contextmanager
    def naming(self, prim: Any) -> Iterator[None]:
        """Raise InputError with a prim's name where its values are not of the types that USD tells, or too few."""
        try:
            yield
        except InputError:
            raise
        except (Tf.ErrorException, TypeError, ValueError, IndexError) as error:
            raise PrimError(
                f"{self.path}: {prim.GetPath()} has a value that cannot be used ({_reason(error)})"
            ) from None

    @contextmanager
    def hearing(self) -> Iterator[None]:
        """Let what usd-core complains of meanwhile become warnings, instead of lines on standard error."""
        collector = UsdUtils.CoalescingDiagnosticDelegate()
        try:
            yield
        finally:
            self._pass_on(each.commentary for each in collector.TakeUncoalescedDiagnostics())

    def _pass_on(self, complaints: Iterable[str]) -> None:
        """Warn of what usd-core complained of, of a missing file once: every prim that refers to it is told."""
        for complaint in dict.fromkeys(complaints):
            if lacking := re.search(r"Could not open asset @([^@]*)@", complaint):
                if lacking[1] in self._lacking:
                    continue
                self._lacking.add(lacking[1])
            if missing := re.search(r"@([^@]*\.mtlx)@", complaint):
                self.warn(
                    "materials in .mtlx files are left out, which usd-core does not open: `usdcat --flatten` of a USD "
                    f"with MaterialX writes them into the file (first {Path(missing[1]).name})"
                )
            elif _HARMLESS not in complaint:
                self.warn(_short(complaint))

    def times(self, attribute: Any) -> list[float]:
        """Return the time codes from start to end at which an attribute has samples, with both ends; [] if it is one.

        What is sampled outside of that time counts as far as it reaches into it.
        """
        if not attribute or self.end <= self.start:
            return []
        try:
            sampled = attribute.GetTimeSamples() if attribute.ValueMightBeTimeVarying() else None
        except Tf.ErrorException as error:
            raise PrimError(f"{self.path}: {attribute.GetPath()} cannot be read ({_reason(error)})") from None
        if sampled is None:
            return []
        return [self.start, *(code for code in sampled if self.start < code < self.end), self.end]

    def release(self) -> None:
        """Let go of the file, once all is read: usd-core would not read it again while anybody holds it."""
        self.usd = self._cache = None

    def claim(self, size: int) -> bool:
        """Take memory for what changes; False where there would be too much in all."""
        self._left -= size
        return self._left >= 0

    def picture(self, attribute: Any) -> tuple[str, Path | bytes] | None:
        """Return the name and the file, or the bytes, of a picture that an attribute names; None where it names none.

        Raises:
            InputError: it is missing, an address, or too large.
        """
        asset = self.still(attribute)
        if not isinstance(asset, Sdf.AssetPath) or not asset.path:
            return None
        name = asset.path
        found = asset.resolvedPath
        if not found and "<UDIM>" in name:
            raise InputError(f"{name} is a picture in tiles (UDIM), expected a single one")
        if not found:
            # The resolver knows no address and nothing that is missing: this says which of both it is.
            folder = Path(attribute.GetPropertyStack(Usd.TimeCode(self.start))[0].layer.realPath or self.path).parent
            return name, named_file(name, folder)
        if Ar.IsPackageRelativePath(found):
            outer, inner = Ar.SplitPackageRelativePathOuter(found)
            return name, _packed(Path(outer), inner)
        return name, named_file(found, self.path.parent)

    def _bake_skins(self) -> None:
        """Give skinned meshes their points at all times, in a layer of memory that is not the file."""
        roots = [prim for prim in self.usd.Traverse() if prim.IsA(UsdSkel.Root)]
        if not roots:
            return
        self.usd.SetEditTarget(self.usd.GetSessionLayer())
        for prim in roots:
            # What is not instanced can be written to.
            prim.SetInstanceable(False)
        collector = UsdUtils.CoalescingDiagnosticDelegate()
        if not UsdSkel.BakeSkinning(Usd.PrimRange(self.usd.GetPseudoRoot())):
            self.warn("a skeleton cannot be followed; its mesh keeps its shape")
        collector.TakeUncoalescedDiagnostics()


def _packed(package: Path, name: str) -> bytes:
    """Return a file out of a .usdz, whose size is looked at before it is read."""
    try:
        with zipfile.ZipFile(package) as packed:
            if packed.getinfo(name).file_size <= MAX_BYTES:
                return packed.read(name)
    # zipfile raises the last for packing that it lacks, and for what needs a password.
    except (OSError, KeyError, ValueError, zipfile.BadZipFile, RuntimeError) as error:
        raise InputError(f"{package}: {name} cannot be read ({_reason(error)})") from None
    raise InputError(f"{package}: {name} is larger than {MAX_BYTES >> 30} GiB, expected a smaller picture")


def _reason(error: Exception) -> str:
    """Return what usd-core says, without the places in its own code."""
    said = re.findall(r"-- (?!\[)(.*)|: '(.*)'", str(error))
    text = next((a or b for a, b in said if a or b), str(error))
    return _short(text) or type(error).__name__


def _short(text: str) -> str:
    """Return a text in one line, without usd-core's addresses in memory, and not longer than a user reads."""
    return textwrap.shorten(re.sub(r"\(instantiating stage on stage .*", "", text), 300, placeholder=" …")
