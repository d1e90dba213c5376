"""Pictures show what is there, where it is, whoever computed the state."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from guard_api import plugins
from guard_api.env import make_environment
from guard_api.errors import PluginError, RunError, SpecError
from guard_api.model.library import load_robot
from guard_api.physics.state import State, state_dtype, state_shapes
from guard_api.rotations import from_rpy, yaw_quaternion
from guard_api.scene.spec import BodyGroup, BodySpec, SceneSpec
from guard_api.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from guard_api.testing.robots import three_link_arm
from guard_api.viewer import Camera, contact_sheet, environment_picture, picture, robot_picture, sheet, write_png
from guard_api.viewer.footprint import Footprint
from guard_api.viewer.home import home_state

SIZE = (120, 90)
RED = (0.9, 0.05, 0.05, 1.0)
ABOVE = Camera(target=(0.0, 0.0, 0.0), distance=6.0, elevation=float(np.radians(89.9)), azimuth=-np.pi / 2)
"""From above, x to the right and y up in the picture."""

TETRAHEDRON = Mesh(vertices=((0.3, 0.3, 0.3), (0.3, -0.3, -0.3), (-0.3, 0.3, -0.3), (-0.3, -0.3, 0.3)), source="here")
SHAPES: list[Shape] = [
    Sphere(radius=0.3),
    Box(half_extents=(0.3, 0.2, 0.1)),
    Cylinder(radius=0.2, half_length=0.3),
    Capsule(radius=0.2, half_length=0.3),
    TETRAHEDRON,
]


def scene_of(*bodies: tuple[Shape, tuple[float, float, float], tuple[float, ...]]) -> tuple[SceneSpec, State]:
    """A scene of static bodies (shape, place, colour), and its state."""
    groups = tuple(
        BodyGroup(name=str(i), body=BodySpec(shape=shape, physics="static", rgba=tuple(rgba)), count=1)
        for i, (shape, _, rgba) in enumerate(bodies)
    )
    scene = SceneSpec(robot=None, groups=groups)
    arrays = {name: np.zeros(shape, state_dtype(name)) for name, shape in state_shapes(scene, 1).items()}
    arrays["body_position"][0] = np.array([place for _, place, _ in bodies]).reshape(-1, 3)
    arrays["body_quaternion"][..., 0] = 1.0
    return scene, State(**arrays)


def reddish(image: np.ndarray) -> np.ndarray:
    """Which pixels are red rather than grey."""
    image = image.astype(int)
    return image[..., 0] - image[..., 1:].max(axis=-1) > 40


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
@pytest.mark.parametrize("x, y", [(0.0, 0.0), (0.8, -0.5)])
def test_a_body_is_seen_where_it_is(shape: Shape, x: float, y: float) -> None:
    scene, state = scene_of((shape, (x, y, 0.4), RED))
    image = picture(scene, state, camera=ABOVE, size=SIZE)
    row, column = (axis.mean() + 0.5 for axis in np.nonzero(reddish(image)))
    pixels_per_metre = 0.5 * SIZE[1] / np.tan(0.5 * ABOVE.field_of_view) / (6.0 - 0.4)
    assert column == pytest.approx(SIZE[0] / 2 + x * pixels_per_metre, abs=1.5)
    assert row == pytest.approx(SIZE[1] / 2 - y * pixels_per_metre, abs=1.5)


def test_a_ball_covers_its_solid_angle() -> None:
    scene, state = scene_of((Sphere(radius=0.5), (0.0, 0.0, 0.0), RED))
    image = picture(replace(scene, ground=False), state, camera=ABOVE, size=(200, 200))
    radius = 100.0 / np.tan(0.5 * ABOVE.field_of_view) * np.tan(np.arcsin(0.5 / 6.0))
    assert reddish(image).sum() == pytest.approx(np.pi * radius**2, rel=0.03)


def test_bodies_turn() -> None:
    scene, state = scene_of((Box(half_extents=(0.5, 0.05, 0.1)), (0.0, 0.0, 0.3), RED))
    seen = reddish(picture(scene, state, camera=ABOVE, size=SIZE))
    turned = replace(state, body_quaternion=yaw_quaternion(np.full((1, 1), np.pi / 2)))
    across = reddish(picture(scene, turned, camera=ABOVE, size=SIZE))
    assert np.ptp(np.nonzero(seen)[1]) > 4 * np.ptp(np.nonzero(seen)[0])
    assert np.ptp(np.nonzero(across)[0]) > 4 * np.ptp(np.nonzero(across)[1])


def test_the_nearer_body_hides_the_further() -> None:
    ball, slab = Sphere(radius=0.2), Box(half_extents=(0.6, 0.6, 0.05))
    scene, state = scene_of((ball, (0.0, 0.0, 0.3), RED), (slab, (0.0, 0.0, 1.5), (0.2, 0.2, 0.2, 1.0)))
    assert not reddish(picture(scene, state, camera=ABOVE, size=SIZE)).any()


def test_things_cast_shadows() -> None:
    scene, state = scene_of((Sphere(radius=0.3), (0.0, 0.0, 1.0), RED))
    lit = picture(SceneSpec(robot=None), scene_of()[1], camera=ABOVE, size=SIZE).astype(int)
    shaded = picture(scene, state, camera=ABOVE, size=SIZE).astype(int)
    darker = (lit - shaded).min(axis=-1) > 30
    assert 50 < (darker & ~reddish(shaded)).sum() < 1500


def test_only_what_feels_nothing_is_left_unlit(monkeypatch: pytest.MonkeyPatch) -> None:
    """The map of where light rays are needed changes no pixel."""
    ball, slab = Sphere(radius=0.2), Box(half_extents=(0.6, 0.02, 0.5))
    scene, state = scene_of((ball, (-0.7, 0.1, 0.9), RED), (slab, (0.4, 0.4, 0.5), (0.2, 0.2, 0.9, 1.0)))
    quick = picture(scene, state, size=SIZE)
    monkeypatch.setattr(Footprint, "covers", lambda self, point: np.ones(len(point), bool))
    assert np.array_equal(quick, picture(scene, state, size=SIZE))


def test_the_same_state_gives_the_same_bits() -> None:
    robot = load_robot("point")
    assert np.array_equal(robot_picture(robot, size=SIZE), robot_picture(robot, size=SIZE))


@pytest.mark.parametrize("backend", ["mujoco", "bullet", "sapien"])
def test_every_backend_gives_the_same_picture(backend: str) -> None:
    reason = plugins.available("guard.backends")[backend]
    if reason is not None:
        pytest.skip(reason)
    pictures = []
    for name in ("ideal", backend):
        environment = make_environment("Goal_Point_8Hazards", backend=name, num_worlds=2, seed=3, workers=1)
        try:
            pictures.append(environment_picture(environment, world=1, size=SIZE).astype(int))
        finally:
            environment.close()
    difference = np.abs(pictures[0] - pictures[1]).max(axis=-1)
    assert (difference > 2).mean() < 0.002, "float32 engines may move an edge, nothing more"


def test_an_environment_shows_robot_goal_and_hazards() -> None:
    environment = make_environment("Goal_Point_8Hazards", backend="ideal", seed=3)
    image = environment_picture(environment, size=(200, 150)).astype(int)
    red, green, blue = np.moveaxis(image, -1, 0)
    assert ((red > green + 40) & (green > blue + 20)).sum() > 10, "the orange robot"
    assert ((green > red + 20) & (green > blue + 20)).sum() > 200, "the green goal"
    hazards = ((blue > red + 20) & (blue > green + 20)).sum()
    assert hazards > 200, "the blue hazards"
    bare = picture(environment.scene, environment.snapshot.state, size=(200, 150), camera=Camera(distance=8.0))
    bare = bare.astype(int)
    assert not ((bare[..., 1] > bare[..., 0] + 20) & (bare[..., 1] > bare[..., 2] + 20)).any(), "phantoms are no bodies"
    environment.close()


def test_one_looks_through_the_translucent() -> None:
    plate = Box(half_extents=(2.0, 2.0, 0.01))
    ball = (Sphere(radius=0.4), (0.0, 0.0, 0.4), RED)
    red = {}
    for alpha in (0.0, 0.25, 0.75):
        scene, state = scene_of(ball, (plate, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0, alpha)))
        shown = picture(scene, state, camera=ABOVE, size=SIZE)[SIZE[1] // 2, SIZE[0] // 2]
        red[alpha] = ((shown[0] / 255 + 0.055) / 1.055) ** 2.4  # sRGB to light
    for alpha in (0.25, 0.75):
        assert red[alpha] == pytest.approx(red[0.0] * (1 - alpha) ** 2, rel=0.1), "through both faces of the plate"


def test_a_robot_without_visuals_is_seen_by_its_collisions() -> None:
    arm = three_link_arm()
    assert not any(link.visuals for link in arm.links)
    assert reddish(robot_picture(arm, size=SIZE)).sum() > 100


def test_joints_move_the_picture() -> None:
    arm = three_link_arm()
    straight = robot_picture(arm, size=SIZE)
    bent = robot_picture(arm, {arm.joints[1].name: 1.0}, size=SIZE)
    assert (straight != bent).any()


def test_home_state_is_the_start_that_engines_get() -> None:
    robot = load_robot("point")
    state = home_state(robot)
    assert state.link_position[0, robot.link_index(robot.root)] == pytest.approx([0.0, 0.0, robot.home.height])


@pytest.mark.parametrize("world", [-1, 1])
def test_a_world_that_is_not_there_is_refused(world: int) -> None:
    scene, state = scene_of()
    with pytest.raises(SpecError, match=f"world is {world}"):
        picture(scene, state, world=world, size=SIZE)


@pytest.mark.parametrize("size", [(0, 90), (120, 100_000)])
def test_a_size_that_is_none_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(SpecError, match="size is"):
        picture(*scene_of(), size=size)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "embreex.mesh_construction", None)
    with pytest.raises(PluginError, match=r"guard-api\[render\]"):
        robot_picture(load_robot("point"), size=SIZE)


def test_png_is_written_whole(tmp_path: Path) -> None:
    image = picture(*scene_of((Sphere(radius=0.3), (0.0, 0.0, 0.3), RED)), size=SIZE)
    write_png(tmp_path / "new" / "ball.png", image)
    with Image.open(tmp_path / "new" / "ball.png") as written:
        assert np.array_equal(np.asarray(written), image)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["ball.png"]
    with pytest.raises(RunError):
        write_png(tmp_path / "new" / "ball.png" / "no.png", image)


def test_the_sheet_has_a_cell_for_every_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sheet, "CELL", SIZE)
    robots = [load_robot("point"), three_link_arm(), load_robot("point")]
    image = contact_sheet(robots, columns=2)
    assert image.shape == (
        2 * (SIZE[1] + sheet.CAPTION + sheet.GAP) + sheet.GAP,
        2 * (SIZE[0] + sheet.GAP) + sheet.GAP,
        3,
    )
    cells = [reddish(half).sum() for half in np.split(image[: image.shape[0] // 2], 2, axis=1)]
    assert min(cells) > 100
    with pytest.raises(SpecError, match="nothing"):
        contact_sheet([])


def test_any_orientation_of_a_planar_scene_is_lit() -> None:
    """A body under the floor or seen from below does no harm."""
    scene, state = scene_of((Box(half_extents=(0.3, 0.2, 0.1)), (0.0, 0.0, -0.5), RED))
    tilted = replace(state, body_quaternion=from_rpy(0.5, 0.4, 0.3)[None, None])
    below = Camera(elevation=-0.5)
    assert reddish(picture(scene, tilted, camera=below, size=SIZE)).any()
