"""One scene on a device that several drivers move, one at a time, each as if it were its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

from clsim.forks import is_orphan
from clsim.render import SceneData
from clsim.scene import World
from clsim.simulator.driving import Driving

Given = ParamSpec("Given")
Returned = TypeVar("Returned")


def one_at_a_time(
    method: Callable[Concatenate[Any, Given], Returned],
) -> Callable[Concatenate[Any, Given], Returned]:
    """Let threads that drive one scene wait for each other: two at once would read what the other is moving."""

    def alone(driver: Any, *args: Given.args, **kwargs: Given.kwargs) -> Returned:
        if is_orphan():  # whose parent may have held the lock; nothing is driven there
            return method(driver, *args, **kwargs)
        with driver._turn.scene.lock:
            return method(driver, *args, **kwargs)

    named: Any = wraps(method)(alone)
    found: Callable[Concatenate[Any, Given], Returned] = named
    return found


class SharedScene:
    """A scene, and whose turn it is to move it.

    Attributes:
        driving: what is set from outside, of the one whose turn it is.
        data: the scene on the device; None before the first step of any.
        lock: held by the thread in which one of them works.
    """

    def __init__(self, world: World) -> None:
        """Begin with nothing on the device."""
        self.driving = Driving(world)
        self.data: SceneData | None = None
        self.lock = threading.RLock()
        self._turn: Turn | None = None
        self._lit: set[str] = set()

    def take(self, turn: Turn) -> None:
        """Let everything be where one driver has put it, and shine as it has set it."""
        before, self._turn = self._turn, turn
        if before is turn:
            return
        if before is not None:
            before.state = self.driving.state()
            self._lit |= set(self.driving.light)
        if turn.state is None:
            self.driving.release()
        else:
            self.driving.set_state(turn.state)
        if self.data is None:
            return
        if self._lit:
            shining = self.driving.shining() | self.driving.light
            for name in self._lit:
                self.data.set_light(name, shining[name])
        self.data.restart_motion()


class Turn:
    """One driver's part in a scene.

    Attributes:
        scene: the scene.
        state: what the driver has set, while others have their turn; None where it has set nothing yet.
    """

    def __init__(self, scene: SharedScene) -> None:
        """Wait for a turn."""
        self.scene = scene
        self.state: tuple[object, ...] | None = None

    @property
    def driving(self) -> Driving:
        """What is set from outside, which is this driver's from now on."""
        self.scene.take(self)
        return self.scene.driving
