"""What `docs/deviations.md` says of contacts accounts for the difference to GUARD's figures: undone, they come out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from guard_api.model.library import load_robot
from tests.robots.motion import drive

pytest.importorskip("guard_mujoco")


@pytest.fixture
def with_model(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Give MuJoCo's models that are made from now on other values in the named arrays."""
    module = sys.modules["guard_mujoco.backend"]
    compiled = module.compile_scene

    def change(**arrays: Any) -> None:
        def compile_scene(scene: Any) -> Any:
            result = compiled(scene)
            for name, value in arrays.items():
                getattr(result.model, name)[:] = value
            return result

        monkeypatch.setattr(module, "compile_scene", compile_scene)

    return change


@pytest.mark.parametrize("preset", ["rigid", "native"])
def test_ant_hovers_where_guards_does_with_guards_contact_margin(preset: Any, with_model: Callable[..., None]) -> None:
    """A margin of 1 cm on the floor and on the robot, which MuJoCo 4 adds up."""
    ant = load_robot("ant")
    assert drive("mujoco", ant, 0.0, 300, preset=preset)[-1].link_position[0, 0, 2] < 0.091
    with_model(pair_margin=0.02)
    states = drive("mujoco", ant, 0.0, 300, preset=preset)
    assert states[-1].link_position[0, 0, 2] == pytest.approx(0.1105, rel=0.02)
    assert states[-1].touch[0] == pytest.approx(0.0335, rel=0.02)


def test_car_turns_like_guards_with_guards_contacts(with_model: Callable[..., None]) -> None:
    """GUARD's own file turns at 1.29 to 1.37 rad/s in MuJoCo 4.0.1 (means of a second over 30 s)."""
    with_model(pair_dim=6, pair_friction=(1.0, 1.0, 0.005, 0.0001, 0.0001))
    states = drive("mujoco", load_robot("car"), (1.0, -1.0), 400, preset="native")
    rate = np.mean([state.link_angular_velocity[0, 0, 2] for state in states[200:]])
    assert rate == pytest.approx(1.33, rel=0.02)
