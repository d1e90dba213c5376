"""Pictures of robots and scenes from neutral data alone: whatever engine made the state, the look is the same."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from guard_api.env import Environment
from guard_api.errors import SpecError
from guard_api.model.robot import RobotModel
from guard_api.physics.state import State
from guard_api.physics.transition import Snapshot
from guard_api.runs.atomic import write_bytes
from guard_api.scene.spec import BodyGroup, SceneSpec
from guard_api.viewer.camera import Camera
from guard_api.viewer.ground import Extents, Ground
from guard_api.viewer.home import home_state
from guard_api.viewer.parts import Part, phantom_parts, scene_parts
from guard_api.viewer.render import render
from guard_api.viewer.surfaces import joined

Image = NDArray[np.uint8]

SIZE: Final = (800, 600)
"""Width and height of a picture [pixel]."""

LARGEST: Final = 8192
"""Width or height that is refused: a typing error, not a picture."""


def picture(
    scene: SceneSpec,
    now: State | Snapshot,
    *,
    groups: Sequence[BodyGroup] = (),
    extents: Extents | None = None,
    world: int = 0,
    camera: Camera | None = None,
    size: tuple[int, int] = SIZE,
) -> Image:
    """Return a picture (height, width, 3) of one world of `scene`, as it is `now`.

    groups: those of an environment; its phantoms are shown where a Snapshot says they are. extents: (xmin, ymin, xmax,
    ymax) [m] of an area to mark on the floor. camera: a default one that has everything in view when None.
    Raises SpecError for a world or size that does not exist, PluginError when the extra `render` is not installed.
    """
    state = now.state if isinstance(now, Snapshot) else now
    if not 0 <= world < len(state.time):
        raise SpecError(f"world is {world}: there are worlds 0 to {len(state.time) - 1}")
    parts = scene_parts(scene, state, world)
    if isinstance(now, Snapshot):
        parts += phantom_parts(groups, now.bodies, world)
    return _framed(parts, Ground(extents=extents) if scene.ground else None, camera, size)


def environment_picture(
    environment: Environment, *, world: int = 0, camera: Camera | None = None, size: tuple[int, int] = SIZE
) -> Image:
    """Return a picture (height, width, 3) of one world of `environment` as it is now; see `picture`."""
    return picture(
        environment.scene, environment.snapshot, groups=environment.groups, extents=environment.spec.extents,
        world=world, camera=camera, size=size,
    )  # fmt: skip


def robot_picture(
    robot: RobotModel,
    joint_position: Mapping[str, float] | None = None,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = SIZE,
) -> Image:
    """Return a picture (height, width, 3) of `robot` at home, some joints at `joint_position` [rad or m] instead."""
    return picture(SceneSpec(robot=robot), home_state(robot, joint_position), camera=camera, size=size)


def png(image: Image) -> bytes:
    """Return `image` (height, width, 3) as PNG bytes; the same image gives the same bytes."""
    buffer = io.BytesIO()
    Pillow.fromarray(image).save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def write_png(path: Path, image: Image) -> None:
    """Write `image` (height, width, 3) to `path`, atomically. Raises RunError when it cannot be written."""
    write_bytes(path, png(image))


def _framed(parts: Sequence[Part], ground: Ground | None, camera: Camera | None, size: tuple[int, int]) -> Image:
    width, height = size
    if not (1 <= width <= LARGEST and 1 <= height <= LARGEST):
        raise SpecError(f"size is {width} x {height}: each must be 1 to {LARGEST}")
    points = joined(parts).vertices.astype(float)
    if ground is not None and ground.extents is not None:
        camera = camera or Camera(margin=1.05)  # the area is its own margin
        xmin, ymin, xmax, ymax = ground.extents
        points = np.concatenate([points, [[x, y, 0.0] for x in (xmin, xmax) for y in (ymin, ymax)]])
    return render(parts, ground, (camera or Camera()).framing(points, width / height), size)
