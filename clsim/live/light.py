"""What a named quality goes by in a scene: how its light changes, and how it is found."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from clsim.live.base_rate import things_go_slowly
from clsim.scene import World
from clsim.scene.driven import CAMERA


@dataclass(frozen=True)
class Light:
    """The light of a scene, as far as settings hang on it."""

    stands_still: bool = False
    """Whether nothing but the camera moves, and no light changes."""
    all_by_paths: bool = False
    """Whether paths find all light, also that straight from lamps."""
    slow: bool = True
    """Whether things go slowly, as they and the light from them do in bundled scenes."""
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

        return cls(
            stands_still=light_stands_still(world) and not lights_set,
            all_by_paths=not light_is_found_apart(world),
            slow=not driven and things_go_slowly(world, fps),
            watched=camera_watches(world) and CAMERA not in driven and not lights_set,
            lamps_move=lamps_move(world),
        )
