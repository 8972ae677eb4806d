"""First-hit rays a CPU-second of clsim's search beside Embree's, one ray a pixel: single rays and packets of 16.

python -m tools.speed.embree_rate [SCENE ...] [--resolution 346x260] [--rounds 5]

Needs the wheel ``embreex`` for Embree itself, and a C compiler for the loop that calls it. One thread; both search the
same triangles, as they are at time 0, for the same rays, in turn; figures are medians.
A packet is 16 neighbours of a row.
"""

from __future__ import annotations

import argparse
import ctypes
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tools.speed.first_hit_rate import search_of

# Embree 4's own names and layouts; a hit has room for more than it needs.
LOOPS = r"""
#include <stddef.h>
#include <string.h>
typedef struct __attribute__((aligned(16))) { float o[3], near, d[3], time, far;
  unsigned mask, id, flags, hit[12]; } Ray;
typedef struct __attribute__((aligned(64))) { float o[3][16], near[16], d[3][16], time[16], far[16];
  unsigned mask[16], id[16], flags[16], hit[12][16]; } Rays;
void *rtcNewDevice(const char *), *rtcNewScene(void *), *rtcNewGeometry(void *, int);
void *rtcSetNewGeometryBuffer(void *, int, unsigned, int, size_t, size_t);
void rtcCommitGeometry(void *), rtcCommitScene(void *), rtcIntersect1(void *, Ray *, void *);
void rtcIntersect16(const int *, void *, Rays *, void *);
unsigned rtcAttachGeometry(void *, void *);
void *build(const float *vertices, size_t n, const unsigned *triangles, size_t m) {
  void *device = rtcNewDevice("threads=1"), *scene = rtcNewScene(device), *mesh = rtcNewGeometry(device, 0);
  memcpy(rtcSetNewGeometryBuffer(mesh, 1, 0, 0x9003, 12, n), vertices, 12 * n);
  memcpy(rtcSetNewGeometryBuffer(mesh, 0, 0, 0x5003, 12, m), triangles, 12 * m);
  rtcCommitGeometry(mesh); rtcAttachGeometry(scene, mesh); rtcCommitScene(scene);
  return scene;
}
void single(void *scene, size_t n, const float (*o)[3], const float (*d)[3], float *far) {
  for (size_t i = 0; i < n; i++) {
    Ray r = {{o[i][0], o[i][1], o[i][2]}, 0, {d[i][0], d[i][1], d[i][2]}, 0, 1e30f, -1u, 0, 0, {0}};
    r.hit[6] = -1u;
    rtcIntersect1(scene, &r, NULL);
    far[i] = r.far;
  }
}
void packets(void *scene, size_t n, const float (*o)[3], const float (*d)[3], float *far) {
  int valid[16] __attribute__((aligned(64)));
  for (size_t i = 0; i < n; i += 16) {
    Rays r;
    memset(&r, 0, sizeof r);
    for (int j = 0; j < 16; j++) {
      size_t at = i + j < n ? i + j : n - 1;
      valid[j] = i + j < n ? -1 : 0;
      for (int k = 0; k < 3; k++) { r.o[k][j] = o[at][k]; r.d[k][j] = d[at][k]; }
      r.far[j] = 1e30f; r.mask[j] = r.hit[6][j] = -1u;
    }
    rtcIntersect16(valid, scene, &r, NULL);
    for (int j = 0; j < 16 && i + j < n; j++) far[i + j] = r.far[j];
  }
}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=["two-boxes", "cornell"])
    parser.add_argument("--resolution", default="346x260")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    width, height = map(int, given.resolution.split("x"))
    print("| scene | triangles | clsim, M rays a second | Embree, single | Embree, 16 | hits alike |")
    print("|---|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as folder:
        loops = compiled(Path(folder))
        for scene in given.scenes:
            print(row(scene, width, height, loops, given.rounds), flush=True)


def compiled(folder: Path) -> Any:
    """Return the loops above, linked with the library in embreex."""
    found = find_spec("embreex")
    if found is None or found.origin is None:
        raise SystemExit("embree_rate: pip install embreex")
    libraries = Path(found.origin).parents[1] / "embreex.libs"
    for each in sorted(libraries.glob("lib*"), key=lambda file: "tbb" not in file.name):
        ctypes.CDLL(str(each), mode=ctypes.RTLD_GLOBAL)
    (folder / "loops.c").write_text(LOOPS)
    command = ["cc", "-O3", "-march=native", "-shared", "-fPIC", "loops.c", "-o", "loops.so"]
    subprocess.run(command, cwd=folder, check=True)
    loops: Any = ctypes.CDLL(str(folder / "loops.so"))
    loops.build.restype = ctypes.c_void_p
    return loops


def row(scene: str, width: int, height: int, loops: Any, rounds: int) -> str:
    """Measure one scene."""
    import clsim

    world = clsim.load_scene(scene, resolution=(width, height))
    ours, origins, directions, found = search_of(world)
    vertices, triangles = at_start(world)
    tree = ctypes.c_void_p(loops.build(_of(vertices), len(vertices), _of(triangles), len(triangles)))
    far = np.empty(len(origins), np.float32)
    rays = tree, len(origins), _of(origins), _of(directions), _of(far)
    calls: dict[str, Callable[[], Any]] = {
        "ours": ours,
        "single": lambda: loops.single(*rays),
        "packets": lambda: loops.packets(*rays),
    }
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds + 1):
        for name, call in calls.items():
            start = time.process_time()
            call()
            seconds[name].append(time.process_time() - start)
    alike = np.mean(np.isclose(np.minimum(found, 1e30), far, rtol=1e-3))
    rates = (f"{len(origins) / statistics.median(each[1:]) / 1e6:.2f}" for each in seconds.values())
    return f"| {Path(scene).parent.name or scene} | {len(triangles):,} | {' | '.join(rates)} | {alike:.4f} |"


def at_start(world: Any) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
    """Return all vertices ``[n, 3]`` and triangles ``[m, 3]`` of a world at time 0."""
    vertices, triangles, count = [], [], 0
    for each in world.instances:
        pose = each.motion.pose(0.0)
        mesh = world.meshes[each.mesh]
        vertices.append(mesh.vertices @ pose[:3, :3].T + pose[:3, 3])
        triangles.append(mesh.triangles + count)
        count += len(mesh.vertices)
    return np.concatenate(vertices).astype(np.float32), np.concatenate(triangles).astype(np.uint32)


def _of(array: npt.NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


if __name__ == "__main__":
    main()
