"""What cameras recorded: video, pictures and arrays become frames of linear light."""

from __future__ import annotations

from typing import Literal

Transfer = Literal["srgb", "bt709", "pq", "hlg", "linear", "as-is"]
TimeUnit = Literal["s", "ms", "us", "ns"]
Convention = Literal["v2e", "openeb"]
