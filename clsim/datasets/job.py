"""One sequence, from its specification to a folder that is there whole or not at all."""

from __future__ import annotations

import errno
import gc
import hashlib
import json
import os
import platform
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from clsim.datasets.measure import Figures, measure, reasons
from clsim.datasets.scene_file import scene_text
from clsim.datasets.spec import Sample, Spec
from clsim.errors import InputError
from clsim.events.formats.filesink import process_runs
from clsim.live.options import LiveOptions
from clsim.version import VERSION

JOB = "job.json"
_BLOCK = 1 << 20


@dataclass(frozen=True)
class Done:
    """What became of a sequence: its folder's ``job.json``.

    Attributes:
        index: its number.
        job: its hash.
        split: its part.
        files: size and sha256 of each file, by name.
        figures: what it holds.
        rejected: reasons why earlier attempts, or all of them, were not kept.
        kept: whether one was.
        cost: ``cpu_s`` and ``wall_s``, the only values that differ from run to run.
        warnings: what its scene or options ask for and did not get, one sentence each.
    """

    index: int
    job: str
    split: str
    files: dict[str, tuple[int, str]]
    figures: dict[str, Any]
    rejected: tuple[str, ...]
    kept: bool
    cost: dict[str, float]
    warnings: tuple[str, ...] = ()
    clsim_version: str = VERSION


def sequence_folder(out: Path, index: int) -> Path:
    """Return where a sequence lies."""
    return out / "sequences" / f"{index:06d}"


def read_done(folder: Path, *, verify: bool = False) -> Done | None:
    """Return what a sequence's ``job.json`` tells, None unless all of its files are there in their sizes.

    ``verify`` reads them and compares their hashes too.
    """
    try:
        done = Done(**json.loads((folder / JOB).read_text(encoding="utf-8")))
        files = {str(name): (int(size), str(digest)) for name, (size, digest) in done.files.items()}
        for name, (size, digest) in files.items():
            file = folder / name
            if file.stat().st_size != size or (verify and _digest(file) != digest):
                return None
    except (OSError, ValueError, TypeError, AttributeError):
        return None
    return replace(done, files=files, rejected=tuple(done.rejected), warnings=tuple(done.warnings))


def run_job(spec: Spec, index: int, out: str, threads: int | None) -> Done:
    """Make a sequence, unless it is there, and return what became of it.

    Everything is written under a hidden name beside it, brought to the disk, and renamed; ``job.json`` comes last. Two
    that make the same one at a time do no harm: the second to finish gives way.

    Raises:
        InputError: what was drawn makes no scene or run.
    """
    target = sequence_folder(Path(out), index)
    job = spec.job_hash(index)
    done = read_done(target)
    if done is not None and done.job == job:
        return done
    started = time.perf_counter(), time.process_time()
    rejected: list[str] = []
    with _part_of(target) as part:
        sample, figures = spec.sample(index), None
        warnings: tuple[str, ...] = ()
        for attempt in range(spec.reject.attempts):
            sample = spec.sample(index, attempt)
            figures, warnings = _run(spec, sample, part, threads)
            why = reasons(figures, spec.reject)
            if not why:
                break
            rejected.append(f"attempt {attempt}: {'; '.join(why)}")
            _empty(part)
        kept = len(rejected) < spec.reject.attempts
        files = {name: (file.stat().st_size, _digest(file)) for name, file in _files(part) if kept}
        for _, file in _files(part):
            _sync(file)
        cost = {"cpu_s": time.process_time() - started[1], "wall_s": time.perf_counter() - started[0]}
        told = asdict(figures) if figures is not None and kept else {}
        done = Done(index, job, sample.split, files, told, tuple(rejected), kept, cost, warnings)
        return _publish(part, target, done)


def _run(spec: Spec, sample: Sample, part: Path, threads: int | None) -> tuple[Figures, tuple[str, ...]]:
    """Simulate into the folder and return what came of it, and what was asked for in vain."""
    from clsim.live.session import open_live

    (part / "scene.toml").write_text(scene_text(sample.scene), encoding="utf-8")
    given = sample.run | {"scene": str(part / "scene.toml"), "strict": False, "threads": threads}
    names = spec.outputs()
    try:
        options = replace(LiveOptions.from_dict(given), outputs=tuple(str(part / name) for name in names))
        # What files tell of their making must not hang on where and by which process they were made.
        session = open_live(options, told={"scene": "scene.toml", "outputs": names, "threads": None})
    except InputError as error:  # the hidden folder will be gone when the user reads this
        told = str(error).replace(f" in {part}", "").replace(f"{part}{os.sep}scene.toml", "the scene that is drawn")
        raise InputError(told.replace(f"{part}{os.sep}", "")) from None
    warnings = session.warnings
    try:
        summary = session.run()
    finally:
        del session
        gc.collect()
    for name in names:
        (part / f"{name}.json").unlink(missing_ok=True)  # tells of the clock
    return measure(part, summary, options), warnings


@contextmanager
def _part_of(target: Path) -> Iterator[Path]:
    """Yield a hidden folder beside ``target``, which is gone afterwards, and so are those that killed ones left."""
    target.parent.mkdir(parents=True, exist_ok=True)
    begin = f".{target.name}.{platform.node()}."
    for left in target.parent.glob(f"{begin}*.part"):
        pid = re.fullmatch(re.escape(begin) + r"(\d+)\.part", left.name)
        if pid is not None and not process_runs(int(pid[1])):
            shutil.rmtree(left, ignore_errors=True)
    part = target.with_name(f"{begin}{os.getpid()}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    try:
        yield part
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _publish(part: Path, target: Path, done: Done) -> Done:
    """Give the folder its name and then its ``job.json``."""
    if target.exists():
        other = read_done(target)
        if other is not None and other.job == done.job:
            return other
        shutil.rmtree(target, ignore_errors=True)  # torn, or of another specification
    _sync(part)
    try:
        os.rename(part, target)
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        # Another worker was faster, and is at its job.json.
        return done
    _sync(target.parent)
    text = json.dumps(asdict(done), indent=1) + "\n"
    temporary = target / f".{JOB}.part"
    temporary.write_text(text, encoding="utf-8")
    _sync(temporary)
    os.replace(temporary, target / JOB)
    _sync(target)
    return done


def _files(folder: Path) -> list[tuple[str, Path]]:
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return [(str(path.relative_to(folder)), path) for path in found]


def _empty(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


def _digest(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open("rb") as stream:
        while block := stream.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _sync(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
