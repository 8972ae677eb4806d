"""Real recordings, which lie beside the checkout where there are any."""

from pathlib import Path

REAL = Path(__file__).resolve().parents[3] / "shared" / "real"
