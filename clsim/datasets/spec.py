"""The specification of a data set: what varies, how, and what is written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from clsim.datasets.draw import Drawer, Seeds, check, split_of
from clsim.datasets.scene_file import whole_paths
from clsim.datasets.toml import read_toml
from clsim.errors import InputError
from clsim.live.options import LiveOptions
from clsim.values import from_plain, hint, read_fields
from clsim.version import VERSION

Layout = Literal["h5", "dsec"]
_NOT_OF_RUNS = ("scene", "outputs", "files", "seed", "loop", "pace", "governor", "ring", "threads", "strict", "opencl")
"""Options of a run that a data set sets itself, or that concern a clock."""


@dataclass(frozen=True)
class Limits:
    """Which sequences are kept; a pair is the smallest and largest value. Others are drawn anew."""

    attempts: int = 5
    """How often a sequence is drawn, at most."""
    events_per_pixel_s: tuple[float, float] | None = None
    flow_p95_px: tuple[float, float] | None = None
    """95th percentile of flow from one frame of truth to the next, over all pixels and frames."""
    moving_share: tuple[float, float] | None = None
    """Share of pixels whose flow is above a tenth of a pixel."""
    nearest_m: float | None = None
    """Least depth: a camera inside of something sees it nearer."""

    def __post_init__(self) -> None:
        """Refuse values of other types."""
        read_fields(self)
        if self.attempts < 1:
            raise InputError(f"`attempts` must be at least 1, got {self.attempts}")

    @property
    def needs(self) -> tuple[str, ...]:
        """What of truth they are told by."""
        flow = ("flow",) if self.flow_p95_px is not None or self.moving_share is not None else ()
        return (*flow, *(("depth",) if self.nearest_m is not None else ()))


@dataclass(frozen=True)
class Spec:
    """A data set.

    Attributes:
        name: what it is called.
        count: number of sequences.
        parts: name and share of each part (train, val, test); none where there is one.
        seeds: of the streams.
        run: template of a run's options.
        scene: template of a scene.
        layout: how events and truth are written.
        also: names of further event files, such as ``events.aedat4``.
        reject: which sequences are kept.
    """

    name: str
    count: int
    parts: tuple[tuple[str, float], ...]
    seeds: Seeds
    run: dict[str, Any]
    scene: dict[str, Any]
    layout: Layout = "h5"
    also: tuple[str, ...] = ()
    reject: Limits = field(default_factory=Limits)

    @property
    def digest(self) -> str:
        """What its sequences hang on, as a hash: all but how many there are, and the version of clsim."""
        told = [self.parts, vars(self.seeds), self.run, self.scene, self.layout, self.also, vars(self.reject), VERSION]
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()

    def job_hash(self, index: int) -> str:
        """Return the hash of one sequence."""
        return hashlib.sha256(f"{self.digest}:{index}".encode()).hexdigest()

    def outputs(self) -> tuple[str, ...]:
        """Return the names of what each sequence has."""
        return ("events.h5" if self.layout == "h5" else "sequence.dsec", *self.also)

    def sample(self, index: int, attempt: int = 0) -> Sample:
        """Return what is drawn for a sequence."""
        drawer = Drawer(self.seeds, index, attempt, split_of(index, self.parts), self.parts)
        run = drawer.draw(self.run, "run", "sensor") | {"seed": drawer.seed()}
        return Sample(index, drawer.split, run, drawer.draw(self.scene, "scene", "scene"))


@dataclass(frozen=True)
class Sample:
    """What is drawn for a sequence: its part, options of its run, and its scene."""

    index: int
    split: str
    run: dict[str, Any]
    scene: dict[str, Any]


def bundled_specs() -> dict[str, Path]:
    """Return the bundled specifications by name."""
    folder = resources.files("clsim.datasets.specs")
    return {Path(str(each)).stem: Path(str(each)) for each in folder.iterdir() if each.name.endswith(".toml")}


def load_spec(name: str, count: int | None = None) -> Spec:
    """Read a specification: a bundled one by name, or a TOML file; ``count`` replaces its number of sequences.

    Raises:
        InputError: it cannot be read, a key is unknown, or a value cannot be.
    """
    bundled = bundled_specs()
    path = bundled.get(name, Path(name))
    if path.suffix != ".toml":
        raise InputError(f"{name}: is no specification; expected a .toml file or one of {', '.join(sorted(bundled))}")
    told = read_toml(path)
    try:
        return _spec(path, told, count, Path.cwd() if name in bundled else path.resolve().parent)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _spec(path: Path, told: dict[str, Any], count: int | None, folder: Path) -> Spec:
    """Return the specification, whose files are seen from that folder: a bundled one's are the user's."""
    known = ("description", "count", "split", "seeds", "run", "scene", "write", "reject")
    for key in told:
        if key not in known:
            raise InputError(f"there is no key {key!r}; {hint(key, known)}")
    for key in ("split", "seeds", "run", "scene", "write", "reject"):
        if not isinstance(told.get(key, {}), Mapping):
            raise InputError(f"{key} must be a table")
    count = told.get("count", 1) if count is None else count
    if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= 10_000_000:
        raise InputError(f"count must be a whole number from 1 to 10000000, got {count!r}")
    run, scene = (check(whole_paths(told.get(key, {}), folder), key, folder) for key in ("run", "scene"))
    allowed = sorted({each.name for each in fields(LiveOptions)} - set(_NOT_OF_RUNS))
    for key in run:
        if key not in allowed:
            raise InputError(f"run.{key} is no option of sequences; {hint(key, allowed)}")
    write = from_plain(_Write, told.get("write", {}))
    spec = Spec(
        path.stem, count, _parts(told.get("split", {})), from_plain(Seeds, told.get("seeds", {})), run, scene,
        write.layout, write.also, from_plain(Limits, told.get("reject", {})),
    )  # fmt: skip
    _check_reject(spec)
    return spec


@dataclass(frozen=True)
class _Write:
    layout: Layout = "h5"
    also: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        read_fields(self)
        for name in self.also:
            if Path(name).name != name or name in ("job.json", "scene.toml"):
                raise InputError(f"write.also must be names of files in a sequence's folder, got {name!r}")


def _parts(told: Mapping[str, Any]) -> tuple[tuple[str, float], ...]:
    shares = list(told.items())
    if any(not isinstance(share, int | float) or isinstance(share, bool) or share < 0 for _, share in shares):
        raise InputError(f"split must have a share of 0 or more for each part, got {dict(told)}")
    total = sum(share for _, share in shares)
    if shares and abs(total - 1) > 1e-6:
        raise InputError(f"the shares of split must add up to 1, got {total:g}")
    return tuple((name, float(share)) for name, share in shares if share)


def _check_reject(spec: Spec) -> None:
    truth = spec.run.get("truth", ())
    given = (truth,) if isinstance(truth, str) else tuple(truth)
    for need in spec.reject.needs:
        if spec.layout != "h5" or not {need, "all"} & set(given):
            raise InputError(f"reject needs run.truth to hold {need!r}, and the layout h5")
