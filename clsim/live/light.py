"""What a named quality goes by in a scene: how its light changes, and how it is found."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from clsim.live.base_rate import fastest_px_s
from clsim.live.quality import SLOW_SHARE
from clsim.scene import World
from clsim.scene.driven import CAMERA

FAST_PX = 2.0
"""Way from frame to frame beyond which frames alone miss too much of what is seen [pixels]."""


@dataclass(frozen=True)
class Light:
    """The light of a scene and how fast things move in it, as far as settings hang on that."""

    stands_still: bool = False
    """Whether nothing but the camera moves, and no light changes."""
    all_by_paths: bool = False
    """Whether paths find all light, also that straight from lamps."""
    slow: bool = True
    """Whether things go slowly, as they and the light from them do in bundled scenes."""
    fast: bool = False
    """Whether rigid things go so far from frame to frame, before a camera that stands still, that much is missed."""
    watched: bool = False
    """Whether the camera stands still, and light changes by what moves alone."""
    lamps_move: bool = False
    """Whether something that shines moves or deforms."""

    @classmethod
    def of(cls, world: World, fps: float, driven: Collection[str] = (), *, lights_set: bool = False) -> Light:
        """Return that of a scene at so many frames a second.

        What ``driven`` names is moved from outside: it may go fast, and the camera need not stand still. Where
        ``lights_set`` says that lights change from outside, their light does not stand still.
        """
        from clsim.render import camera_watches, lamps_move, light_is_found_apart, light_stands_still

        way_px, camera = fastest_px_s(world) / fps, world.camera
        watched = camera_watches(world) and CAMERA not in driven and not lights_set
        return cls(
            stands_still=light_stands_still(world) and not lights_set,
            all_by_paths=not light_is_found_apart(world),
            slow=not driven and way_px <= SLOW_SHARE * camera.width,
            # Before such a camera few pixels change. One that exposes sees no instants between frames.
            fast=way_px > FAST_PX and watched and not driven and camera.shutter_s == 0,
            watched=watched,
            lamps_move=lamps_move(world),
        )
