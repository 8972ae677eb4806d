"""Poses and lamp light of a world that are set from outside while it is simulated."""

from __future__ import annotations

from clsim.errors import InputError
from clsim.scene import World
from clsim.scene.driven import CAMERA, Driven, Place, place_of, placed, with_driven
from clsim.scene.motion import Matrix
from clsim.scene.world import Vec3


class Driving:
    """Poses and light of a world that is set, by name.

    Attributes:
        names: what has a pose that can be set.
        light: the radiance of the lights that were set.
    """

    def __init__(self, world: World) -> None:
        """Begin with nothing set."""
        self._world = world
        self._motions = placed(world)
        self._driven: dict[str, Driven] = {}
        self._sealed = False
        self._pending: dict[str, Place] = {}
        self.names = tuple(self._motions)
        self.light: dict[str, Vec3] = {}

    @property
    def moved(self) -> tuple[str, ...]:
        """The names of all whose poses were set."""
        return tuple(name for name, driven in self._driven.items() if driven.keys)

    def seal(self) -> World:
        """Return the world moved by what is set; from now on what stands still in it cannot be set any more.

        What moves by itself, and the camera, can still be set: a camera that stands still while it exposes has a kernel
        that knows it.
        """
        exposes = self._world.camera.shutter_s > 0
        for name, motion in self._motions.items():
            if motion.duration_s > 0 or (name == CAMERA and not exposes):
                self._driven.setdefault(name, Driven(motion))
        self._sealed = True
        return with_driven(self._world, self._driven)

    def set_place(self, name: str, place: Place, at_us: int | None, passed_us: int | None) -> None:
        """Say where something is at a time [µs], or when the step ends; ``passed_us`` is that of the last frame.

        Raises:
            InputError: nothing of that name can be set, or not for that time.
        """
        self._check(name)
        if name not in self._driven:
            if self._sealed:
                raise InputError(
                    f"{name} stands still in {self._world.name} and is built in; to move it later, set its pose before "
                    "the first step too"
                )
            self._driven[name] = Driven(self._motions[name])
        if at_us is None:
            self._pending[name] = place
        else:
            self._add_key(name, place, at_us, passed_us)

    def end_step(self, until_us: int, passed_us: int | None) -> None:
        """Tell that the step for whose end poses were set ends at that time [µs]; raises InputError as `set_place`."""
        for name, place in self._pending.items():
            self._add_key(name, place, until_us, passed_us)
        self._pending = {}

    def forget_before(self, time_us: int) -> None:
        """Let go of poses that nothing from that time on needs."""
        for driven in self._driven.values():
            driven.forget_before(time_us * 1e-6 - self._world.camera.shutter_s)

    def pose(self, name: str, time_us: float) -> Matrix:
        """Return where something is; raises InputError where nothing is called so."""
        self._check(name)
        pose: Matrix = self._driven.get(name, self._motions[name]).pose(time_us * 1e-6).copy()
        return pose

    def shining(self) -> dict[str, Vec3]:
        """Return the radiance that lights and materials with names have in the world, those without light left out."""
        world = self._world
        found = {light.name: light.radiance for light in world.sphere_lights}
        found |= {light.name: light.intensity for light in world.punctual_lights}
        found |= {material.name: material.emission for material in world.materials}
        return {name: radiance for name, radiance in found.items() if name and any(radiance)}

    def set_light(self, name: str, radiance: Vec3) -> None:
        """Note another radiance; raises InputError where nothing of that name shines."""
        shining = self.shining()
        if name not in shining:
            known = ", ".join(sorted(shining)) or "none has a name"
            raise InputError(f"no light called {name!r} shines in {self._world.name}, expected one of: {known}")
        self.light[name] = radiance

    def release(self) -> None:
        """Let everything move as in the world, and forget what was set of light."""
        for driven in self._driven.values():
            driven.release()
        self._pending, self.light = {}, {}

    def state(self) -> tuple[object, ...]:
        """Return all that was set, for `set_state`."""
        return {name: driven.keys for name, driven in self._driven.items()}, dict(self._pending), dict(self.light)

    def set_state(self, state: tuple[object, ...]) -> None:
        """Go back to what had been set."""
        keys, pending, light = state
        for name, driven in self._driven.items():
            driven.keys = keys.get(name, ())  # type: ignore[attr-defined]
        self._pending, self.light = dict(pending), dict(light)  # type: ignore[call-overload]

    def _check(self, name: str) -> None:
        if name not in self._motions:
            raise InputError(
                f"nothing in {self._world.name} is called {name!r}, expected one of: {', '.join(self.names)}"
            )

    def _add_key(self, name: str, place: Place, at_us: int, passed_us: int | None) -> None:
        driven = self._driven[name]
        if at_us < 0 or (passed_us is not None and at_us <= passed_us):
            raise InputError(f"`at_us` must be after the last frame, at {passed_us or 0} µs, got {at_us}")
        if driven.last_s is not None and at_us / 1e6 < driven.last_s:
            last_us = round(driven.last_s * 1e6)
            raise InputError(
                f"{name} has a pose at {last_us} µs already, expected one at that time or later, got {at_us}"
            )
        if driven.last_s is None and passed_us is not None:
            driven.set(passed_us / 1e6, place_of(driven.pose(passed_us * 1e-6)))
        driven.set(at_us / 1e6, place)
