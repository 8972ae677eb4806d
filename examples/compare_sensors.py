"""The same scene before four sensors: the ideal pixel, and presets of real cameras.

Noise, bandwidth, thresholds that differ from pixel to pixel, and readout are each camera's own.
"""

import numpy as np
from pictures import events_picture, save

import clsim
from clsim.sensor.statistics import statistics

panels = {}
for sensor in (None, "dvs128", "davis346", "gen4.1"):
    name = sensor or "ideal"
    with clsim.stream(
        "two-boxes", resolution=(173, 130), sensor=sensor, quality="draft", fps=240.0, frame_count=25, seed=1
    ) as run:
        events = np.concatenate([batch.copy() for batch in run])
    told = statistics(events, 173, 130)
    print(
        f"{name:9s} {len(events):6d} events, {told.on_share:.0%} of them ON, {told.lonely:.1%} lonely, "
        f"half of a pixel's intervals below {told.interval_us[1] / 1000:.1f} ms"
    )
    last = events[events["t"] > events["t"].max() - 15_000]
    panels[f"{name}: {len(last)} events in 15 ms"] = events_picture(last, 173, 130)

save(panels, "compare_sensors.png")
