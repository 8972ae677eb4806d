"""For each field of a run: another value, and what else must be said for that to mean anything."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SCENE = "two-boxes"
POSES = "0 0 0.3 2 0 0 0 1\n0.2 0.3 0.3 2 0 0.6 0 0.8\n0.4 0 0.5 2 0 0 0 1\n0.6 0 0.3 2.2 0 0 0 1\n"
IMU = "".join(
    f"{name}: 0.01\n"
    for kind in ("accelerometer", "gyroscope")
    for name in (f"{kind}_noise_density", f"{kind}_random_walk")
)
LACKS = (
    '<scene version="3.0.0"><sensor type="perspective"/><emitter type="constant"/>'
    '<shape type="sphere"><bsdf type="roughdiffuse"/></shape></scene>'
)
"""A scene that asks for a material that there is not."""


@dataclass
class Row:
    """Another value of a field, and other fields that are there before and after."""

    to: Any
    beside: dict[str, Any] = field(default_factory=dict)


FOLLOWED = {"camera_path": "poses.txt"}
REGRESSED = {"method": "esim-ad"}
REAL = {"pace": "real"}
RECORDED: dict[str, Any] = {"outputs": ("a.h5",), "fps": 60.0}
FIELDS: dict[str, Row] = {
    "scene": Row("cornell"),
    "strict": Row(True, {"scene": "lacks.xml"}),
    "resolution": Row((16, 12)),
    "camera_path": Row("poses.txt"),
    "camera_axes": Row("opengl", FOLLOWED),
    "camera_interpolation": Row("cubic", FOLLOWED),
    "sensor": Row("davis346"),
    "quality": Row("accurate"),
    "sampling": Row("uniform"),
    "probe_spp": Row(2, {"spp": 8}),
    "probe_every": Row(5),
    "spp": Row(4),
    "first_hit_rays": Row(5),
    "noise": Row("independent", {"method": "esim"}),
    "seed": Row(3),
    "sampler": Row("pcg"),
    "follow_specular": Row(False),
    "max_depth": Row(3),
    "threshold": Row((0.3, 0.4)),
    "method": Row("esim-ad"),
    "gate": Row("delta-r", REGRESSED),
    "event_rule": Row("frame"),
    "window": Row(9, REGRESSED),
    "history": Row(2, REGRESSED),
    "confidence": Row(2.0, {"method": "irradiance", "sampling": "uniform"}),
    "duration_s": Row(0.5),
    "frame_count": Row(3),
    "loop": Row(True),
    "fps": Row(50.0),
    "time": Row("lambda=0.5"),
    "time_tolerance_us": Row(20.0, {"time": "adaptive"}),
    "pace": Row("real"),
    "governor": Row(False, REAL),
    "ring": Row("drop-oldest", REAL),
    "outputs": Row(("a.txt",)),
    "files": Row({"text_time": "s"}, {"outputs": ("a.txt",)}),
    "truth": Row(("depth", "poses"), RECORDED),
    "frame_rate": Row(30.0, RECORDED | {"truth": ("depth",)}),
    "pose_rate": Row(100.0, RECORDED | {"truth": ("poses",)}),
    "imu_rate": Row(100.0, RECORDED | {"truth": ("imu",)}),
    "imu_noise": Row("imu.yaml", RECORDED | {"truth": ("imu",)}),
    "threads": Row(1),
    "render_device": Row("cuda:77"),
    "opencl": Row("no such device"),
}


def write_files(folder: Path) -> None:
    """Write the files that rows name."""
    for name, text in {"poses.txt": POSES, "imu.yaml": IMU, "lacks.xml": LACKS}.items():
        (folder / name).write_text(text)
