"""Units, frames and orders, stated once; every array in GUARD keeps them.

* SI units; radians; z up; right-handed frames.
* Quaternions are unit, ordered (w, x, y, z), and rotate link axes into world axes.
* A link's pose and velocity are those of its *link frame* (the frame of the joint that moves it), not of its
  centre of mass. Both velocities are in world axes; the linear one is that of the link-frame origin.
* Joints and links come in the model's order in every array, on every backend.
* Every array leads with the number of worlds N. One world is N = 1.
* A control is what the policy commands, one number per actuator, before clipping to the actuator's range.
"""

from typing import Final

GRAVITY: Final[tuple[float, float, float]] = (0.0, 0.0, -9.81)
"""Gravitational acceleration [m/s^2], world axes."""

MAGNETIC_FIELD: Final[tuple[float, float, float]] = (0.0, -0.5, 0.0)
"""Constant world magnetic field that magnetometers read [arbitrary units]. Source: GUARD's and Safety Gym's worlds."""

DIVERGED_SPEED: Final = 1e5
"""A world in which anything moves faster [m/s or rad/s] has diverged, although its numbers are finite.

Nothing that is built comes near: rotors of electric motors turn at up to 1e4 rad/s. In a timestep of 1 ms such a body
goes 100 m, through whatever it should have touched; and engines clamp speeds further up (PhysX: 1e6 here), so that
some divergences never reach infinity.
"""

BACKEND_API: Final[int] = 1
"""Version of the contract in `guard_api.physics`; a plugin states the one that it was written for."""
