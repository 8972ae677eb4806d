"""Copies of prims at points (``UsdGeomPointInstancer``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import Usd, UsdGeom

from clsim.scene.motion import Matrix
from clsim.scene.usd.motion import moving_codes
from clsim.scene.usd.stage import PrimError, Stage

I64 = npt.NDArray[np.int64]
MAX_KEPT = 1 << 21
"""Matrices that are remembered."""
MATRIX_BYTES = 128
_PLACES = ("positions", "orientations", "orientationsf", "scales", "velocities", "accelerations", "angularVelocities")


class Copies:
    """What an instancer copies, and where to.

    Attributes:
        prototypes: the prims.
        which: of each copy the number of its prototype ``[n]``, −1 where it is not shown.
        codes: time codes at which the copies or their instancer move; [] where they stand still.
    """

    def __init__(self, stage: Stage, prim: Any, prototypes: list[Any], which: I64) -> None:
        """Take what `copies` found."""
        self.prototypes, self.which = prototypes, which
        self._stage, self._prim, self._source = stage, prim, UsdGeom.PointInstancer(prim)
        own = {code for name in _PLACES for code in stage.times(prim.GetAttribute(name))}
        self.codes = sorted({*own, *moving_codes(stage, prim)})
        self._found: dict[float, Matrix] = {}

    def at(self, code: float) -> Matrix:
        """Return the matrices from the prototypes' own spaces to the instancer's ``[n, 4, 4]``."""
        if code not in self._found:
            if len(self._found) * len(self.which) > MAX_KEPT:
                self._found.clear()
            time = Usd.TimeCode(code)
            exclude = UsdGeom.PointInstancer.ExcludeProtoXform
            found = self._source.ComputeInstanceTransformsAtTime(time, time, exclude, UsdGeom.PointInstancer.IgnoreMask)
            rows = np.array(found, np.float64).reshape(-1, 4, 4)
            if len(rows) != len(self.which):
                where = f"{self._stage.path}: {self._prim.GetPath()}"
                raise PrimError(f"{where} has other than its {len(self.which)} copies' places at time {code:g}")
            self._found[code] = rows.transpose(0, 2, 1)
        return self._found[code]

    def moves_within(self, ancestor: Any) -> bool:
        """Tell whether the copies move, in a space that an ancestor of the instancer spans."""
        own = any(self._stage.times(self._prim.GetAttribute(name)) for name in _PLACES)
        return own or bool(moving_codes(self._stage, self._prim, ancestor))

    def place(self, number: int, inside: Matrix) -> Callable[[float], Matrix]:
        """Return where a part of a copy is at time codes; ``inside`` leads from the part to its prototype's place."""
        return lambda code: self._stage.to_world(self._prim, code) @ self.at(code)[number] @ inside

    def inside(self, part: Any, root: Any) -> Matrix:
        """Return the matrix from a part of a prototype to the space in which the prototype stands."""
        return self._stage.to_ancestor(part, root.GetParent())


def copies(stage: Stage, prim: Any, warn: Callable[[str], None], most: int) -> Copies | None:
    """Return the copies of an instancer, whose prototypes keep still within them; None where there are none.

    Args:
        stage: the file.
        prim: a ``UsdGeomPointInstancer``.
        warn: takes what is left out.
        most: how many copies there may be.
    """
    source, name = UsdGeom.PointInstancer(prim), prim.GetName()
    which = np.array(stage.value(source.GetProtoIndicesAttr()) or [], np.int64).ravel()
    prototypes = [stage.usd.GetPrimAtPath(path) for path in source.GetPrototypesRel().GetForwardedTargets()]
    placed = stage.value(source.GetPositionsAttr()) or []
    if not len(which) or len(placed) != len(which) or len(which) > most:
        warn(f"the copies of {name} are left out: it has {len(which)} of them, {len(placed)} places, at most {most}")
        return None
    if not all(prototypes):
        warn(f"the copies of {name} are left out: one of its prototypes is missing")
        return None
    if which.min() < 0 or which.max() >= len(prototypes):
        wrong = which.min() if which.min() < 0 else which.max()
        warn(f"the copies of {name} are left out: one is of prototype {wrong}, of {len(prototypes)}")
        return None
    if stage.times(source.GetProtoIndicesAttr()) or stage.times(source.GetInvisibleIdsAttr()):
        warn(f"copies that appear or vanish are as at the start (first {name})")
    shown = source.ComputeMaskAtTime(Usd.TimeCode(stage.start))
    if shown:
        which = np.where(np.array(shown, bool), which, -1)
    colors = UsdGeom.PrimvarsAPI(prim).GetPrimvar("displayColor")
    if colors and colors.HasAuthoredValue() and colors.GetInterpolation() != UsdGeom.Tokens.constant:
        warn(f"colours of single copies are left out (first {name})")
    found = Copies(stage, prim, prototypes, which)
    if not stage.claim(len(which) * len(found.codes) * MATRIX_BYTES):
        warn(f"the copies of {name} are left out: their places at all times take too much memory")
        return None
    return found
