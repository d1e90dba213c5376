"""The scene's bodies in all worlds: static ones stay, dynamic ones are read back, driven ones follow their targets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from guard_api import rotations
from guard_api.physics.state import Start, is_sound
from guard_api.scene.spec import SceneSpec
from guard_bullet.compile import Instance
from guard_bullet.engine import pybullet
from guard_bullet.shapes import body_frame, xyzw

Array = NDArray[np.float64]


class Bodies:
    """Poses and velocities of B bodies in N worlds, world axes, at their centres of mass.

    position, linear, angular: (N, B, 3); quaternion: (N, B, 4). sound: (N,) False once the engine's numbers of a world
    were not; the arrays keep the last sound ones.
    """

    def __init__(self, scene: SceneSpec, num_worlds: int) -> None:
        count = scene.num_bodies
        self.position, self.quaternion = np.zeros((num_worlds, count, 3)), np.zeros((num_worlds, count, 4))
        self.quaternion[..., 0] = 1.0
        self.linear, self.angular = np.zeros((num_worlds, count, 3)), np.zeros((num_worlds, count, 3))
        self.sound = np.ones(num_worlds, bool)
        kinds = [body.physics for body in scene.bodies]
        self.dynamic = [i for i, kind in enumerate(kinds) if kind == "dynamic"]
        self.driven = [i for i, kind in enumerate(kinds) if kind == "driven"]
        decay = {i: float(np.exp(-scene.bodies[i].damping * scene.timestep)) for i in self.dynamic}
        self._decay = {i: share for i, share in decay.items() if share < 1.0}
        self._axes = np.array([body_frame(body.shape).quaternion for body in scene.bodies]).reshape(-1, 4)
        self._targets: dict[int, tuple[Array, Array]] = {}

    def start(self, mask: NDArray[np.bool_], start: Start) -> None:
        """Take the rows of `start` where `mask` is true; targets not yet reached are forgotten there."""
        self.position[mask], self.quaternion[mask] = start.body_position[mask], start.body_quaternion[mask]
        self.linear[mask] = start.body_linear_velocity[mask]
        self.angular[mask] = start.body_angular_velocity[mask]
        self.sound[mask] = True
        for index, (position, quaternion) in self._targets.items():
            position[mask], quaternion[mask] = self.position[mask, index], self.quaternion[mask, index]

    def write(self, world: int, instance: Instance) -> None:
        """Put world number `world` into its engine instance."""
        for index in range(len(instance.bodies)):
            self._place(world, index, instance)
            self._move(world, index, instance)

    def read(self, worlds: list[int], instances: list[Instance]) -> None:
        """Fetch the dynamic bodies of `worlds`; `instances` are all N engine instances."""
        if not self.dynamic or not worlds:
            return
        rows = []
        for world in worlds:
            instance = instances[world]
            client = instance.client
            for index in self.dynamic:
                body = instance.bodies[index]
                position, orientation = pybullet.getBasePositionAndOrientation(body, client)
                linear, angular = pybullet.getBaseVelocity(body, client)
                rows.append((*position, orientation[3], *orientation[:3], *linear, *angular))
        numbers = np.array(rows).reshape(len(worlds), len(self.dynamic), 13)
        sound = is_sound(numbers, numbers[..., 7:])
        if not sound.all():
            self.sound[np.asarray(worlds)[~sound]] = False
            worlds, numbers = np.asarray(worlds)[sound].tolist(), numbers[sound]
        cell = np.ix_(worlds, self.dynamic)
        self.position[cell], self.linear[cell] = numbers[..., :3], numbers[..., 7:10]
        self.angular[cell] = numbers[..., 10:]
        axes = rotations.conjugate(self._axes[self.dynamic])
        self.quaternion[cell] = rotations.multiply(numbers[..., 3:7], axes)

    def damp(self, worlds: list[int], instances: list[Instance]) -> None:
        """Take from the velocities of damped bodies what they lose in a timestep.

        The engine's own damping of a velocity v has a part that grows with |v|.
        """
        for index, share in self._decay.items():
            for world in worlds:
                body, client = instances[world].bodies[index], instances[world].client
                linear, angular = pybullet.getBaseVelocity(body, client)
                slower = [share * v for v in linear], [share * w for w in angular]
                pybullet.resetBaseVelocity(body, *slower, physicsClientId=client)

    def aim(self, indices: slice, position: Array, quaternion: Array) -> None:
        """Let the driven bodies `indices` reach `position` (N, n, 3), `quaternion` (N, n, 4) in the next step."""
        for k, index in enumerate(range(indices.start, indices.stop)):
            self._targets[index] = np.array(position[:, k], float), np.array(quaternion[:, k], float)

    def depart(self, worlds: list[int], instances: list[Instance], duration: float) -> None:
        """Give the driven bodies the constant velocities that bring them to their targets after `duration` [s].

        The engine moves an immovable body along its velocity and lets it push with it.
        """
        for index in self.driven:
            position, quaternion = self._targets.get(index, (self.position[:, index], self.quaternion[:, index]))
            turn = rotations.multiply(quaternion, rotations.conjugate(self.quaternion[:, index]))
            self.linear[worlds, index] = ((position - self.position[:, index]) / duration)[worlds]
            self.angular[worlds, index] = (_rotation_vector(turn) / duration)[worlds]
            if index in self._targets:
                for world in worlds:
                    self._move(world, index, instances[world])

    def arrive(self, worlds: list[int], instances: list[Instance]) -> None:
        """Set the driven bodies exactly on their targets and at rest in the engine; `linear` keeps how they came."""
        for index, (position, quaternion) in self._targets.items():
            self.position[worlds, index], self.quaternion[worlds, index] = position[worlds], quaternion[worlds]
            for world in worlds:
                self._place(world, index, instances[world])
        self._targets.clear()

    def _place(self, world: int, index: int, instance: Instance) -> None:
        quaternion = rotations.multiply(self.quaternion[world, index], self._axes[index])
        position = self.position[world, index].tolist()
        body, client = instance.bodies[index], instance.client
        pybullet.resetBasePositionAndOrientation(body, position, xyzw(quaternion), physicsClientId=client)

    def _move(self, world: int, index: int, instance: Instance) -> None:
        linear, angular = self.linear[world, index].tolist(), self.angular[world, index].tolist()
        pybullet.resetBaseVelocity(instance.bodies[index], linear, angular, physicsClientId=instance.client)


def _rotation_vector(quaternion: Array) -> Array:
    """Return the rotation vector (N, 3) [rad], shorter way round, of unit quaternions (N, 4)."""
    q = np.where(quaternion[:, :1] < 0.0, -quaternion, quaternion)
    sine = np.sqrt(np.add.reduce(q[:, 1:] ** 2, axis=1))
    angle = 2.0 * np.arctan2(sine, q[:, 0])
    return q[:, 1:] * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0)[:, None]
