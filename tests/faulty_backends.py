"""Backends with one deliberate fault each, made from the ideal one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from guard_api import rotations
from guard_api.errors import BackendError
from guard_api.testing.ideal.world import IdealBackend, IdealWorld

VELOCITIES = ("base_linear_velocity", "base_angular_velocity", "joint_velocity")


class FaultyBackend(IdealBackend):
    """The ideal backend with another world, another scene than it was asked for, or a false promise."""

    def __init__(self, world=IdealWorld, scene=lambda scene: scene, **capabilities):
        self.world, self.scene = world, scene
        self.capabilities = replace(self.capabilities, **capabilities)

    def build(self, scene, num_worlds, threads=1):
        return self.world(self.scene(scene), num_worlds)


def faulty_state(change):
    """A world whose states are reported through `change`."""

    class World(IdealWorld):
        def state(self):
            true = super().state()
            return replace(true, **change(true, self.scene.robot))

    return World


def with_joints(**values):
    """A backend that builds every joint with other values than the model's."""

    def change(scene):
        joints = tuple(replace(joint, **values) for joint in scene.robot.joints)
        return replace(scene, robot=replace(scene.robot, joints=joints))

    return FaultyBackend(scene=change)


def with_actuators(**values):
    """A backend that builds every actuator with other values than the model's."""

    def change(scene):
        actuators = tuple(replace(actuator, **values) for actuator in scene.robot.actuators)
        return replace(scene, robot=replace(scene.robot, actuators=actuators))

    return FaultyBackend(scene=change)


def with_bodies(**values):
    """A backend that builds every body with other values than the scene's."""

    def change(scene):
        groups = tuple(replace(group, body=replace(group.body, **values)) for group in scene.groups)
        return replace(scene, groups=groups)

    return FaultyBackend(scene=change)


def with_links(change):
    """A backend that builds changed links."""

    def of_scene(scene):
        return replace(scene, robot=replace(scene.robot, links=tuple(change(link) for link in scene.robot.links)))

    return FaultyBackend(scene=of_scene)


def at_com(state, robot):
    arm = rotations.rotate(state.link_quaternion, np.array([link.com for link in robot.links]))
    return {
        "link_position": state.link_position + arm,
        "link_linear_velocity": state.link_linear_velocity + rotations.cross(state.link_angular_velocity, arm),
    }


class Stale(IdealWorld):
    """Reports link poses of before the last step, as an engine without a forward pass does."""

    def step(self, control, substeps):
        self.old = super().state()
        super().step(control, substeps)

    def state(self):
        now = super().state()
        old = getattr(self, "old", now)
        return replace(now, link_position=old.link_position, link_quaternion=old.link_quaternion)


class HeldEffort(IdealWorld):
    """Evaluates servos once per step."""

    def step(self, control, substeps):
        effort = self._law.joint_effort(self._law.geared(control), self._data["joint_position"],
                                        self._data["joint_velocity"])  # fmt: skip
        law = self._law.joint_effort
        self._law.joint_effort = lambda geared, q, qd: effort
        super().step(control, substeps)
        self._law.joint_effort = law


class ClippedSprings(IdealWorld):
    """Counts springs among the efforts that a joint's limit clips."""

    def __init__(self, scene, num_worlds):
        super().__init__(scene, num_worlds)
        limit, spring = self._law.joint_limit, self._law.spring_effort
        self._law.spring_effort = lambda q: np.clip(spring(q), -limit, limit)


class SpringsAmongEfforts(IdealWorld):
    """Reports springs as the actuators' effort."""

    def state(self):
        true = super().state()
        return replace(true, joint_effort=true.joint_effort + self._law.spring_effort(true.joint_position))


class EarlyCeiling(IdealWorld):
    """Looks at the ceiling at every substep."""

    def step(self, control, substeps):
        for _ in range(substeps):
            super().step(control, 1)


class CeilingForTheCom(IdealWorld):
    """Looks at the height of the thrust link's centre of mass."""

    def _thrust_heights(self):
        state, links = self.state(), self._law.thrust_link
        return at_com(state, self.scene.robot)["link_position"][:, links, 2]


class ShortStep(IdealWorld):
    """Advances one substep too few."""

    def step(self, control, substeps):
        super().step(control, max(1, substeps - 1))


class RoundedClock(IdealWorld):
    """Keeps time in float32."""

    def step(self, control, substeps):
        super().step(control, substeps)
        self._data["time"] = self._data["time"].astype(np.float32).astype(float)


class Disturbed(IdealWorld):
    """Moves by one rounding unit when it is looked at."""

    def state(self):
        state = super().state()
        self._data["joint_velocity"] = np.nextafter(self._data["joint_velocity"], np.inf)
        return state


class LiveViews(IdealWorld):
    """Hands out the same array each time."""

    def state(self):
        state = super().state()
        if not hasattr(self, "view"):
            self.view = state.joint_position
        self.view[...] = state.joint_position
        return replace(state, joint_position=self.view)


class WholeReset(IdealWorld):
    """Resets all worlds, whatever the mask."""

    def reset(self, mask, start):
        super().reset(np.ones_like(mask), start)


class LingeringReset(IdealWorld):
    """Keeps the velocities over a reset after the first."""

    def reset(self, mask, start):
        kept = {name: self._data[name] for name in VELOCITIES}
        super().reset(mask, start)
        if hasattr(self, "started"):
            self._data |= kept
        self.started = True


class Coupled(IdealWorld):
    """Lets the number of worlds into the last bits of each."""

    def step(self, control, substeps):
        super().step(control, substeps)
        self._data["joint_velocity"] = self._data["joint_velocity"] * (1.0 + 1e-15 * self.num_worlds)


class Leaking(IdealWorld):
    """Lets the mean speed of all worlds into each."""

    def step(self, control, substeps):
        super().step(control, substeps)
        self._data["joint_velocity"] = self._data["joint_velocity"] + 1e-12 * self._data["joint_velocity"].mean()


class Raising(IdealWorld):
    """Raises on a NaN."""

    def step(self, control, substeps):
        if not np.isfinite(control).all():
            raise ValueError("NaN")
        super().step(control, substeps)


class Clipping(IdealWorld):
    """Clips what is infinite."""

    def step(self, control, substeps):
        super().step(np.clip(control, -1e9, 1e9), substeps)


class Deserted(IdealWorld):
    """Raises when no world is left to step."""

    def step(self, control, substeps):
        super().step(control, substeps)
        np.stack([row for row, ok in zip(control, self._data["ok"], strict=True) if ok])


class Undead(IdealWorld):
    """Steps on after it was closed."""

    def close(self):
        pass


class SilentReset(IdealWorld):
    """Puts a world that failed back to zero and says that all is well."""

    def step(self, control, substeps):
        super().step(control, substeps)
        bad = ~self._data["ok"]
        self._data["joint_velocity"] = np.where(bad[:, None], 0.0, self._data["joint_velocity"])
        self._data["ok"] = np.ones_like(bad)


class Trusting(IdealWorld):
    """Takes every finite number for physics."""

    def _speeds(self, now):
        return []


class Forgetful(IdealWorld):
    """Leaves the velocities out of its snapshots."""

    def restore(self, blob):
        super().restore(blob)
        self._data |= {name: np.zeros_like(self._data[name]) for name in VELOCITIES}


class Credulous(IdealWorld):
    """Takes any bytes for a snapshot."""

    def restore(self, blob):
        try:
            super().restore(blob)
        except BackendError:
            return


class Bouncing(IdealWorld):
    """Throws a joint back from its stop at a twentieth of its speed."""

    def _move_robot(self, robot, now, geared, thrust):
        moved = super()._move_robot(robot, now, geared, thrust)
        q = moved["joint_position"]
        stops = (q == self._lower) | (q == self._upper)
        back = -0.05 * now["joint_velocity"]
        return moved | {"joint_velocity": np.where(stops, back, moved["joint_velocity"])}


class ClippedStops(IdealWorld):
    """Holds a joint at its stop by taking its speed away, which nothing else of the robot feels."""

    def _move_robot(self, robot, now, geared, thrust):
        lower, upper = self._lower, self._upper
        self._lower, self._upper = np.full_like(lower, -np.inf), np.full_like(upper, np.inf)
        moved = super()._move_robot(robot, now, geared, thrust)
        self._lower, self._upper = lower, upper
        q = np.clip(moved["joint_position"], lower, upper)
        speed = np.where(q == moved["joint_position"], moved["joint_velocity"], 0.0)
        return moved | {"joint_position": q, "joint_velocity": speed}
