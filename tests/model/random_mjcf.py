"""Random MJCF texts for property tests: bodies in bodies, with classes, frames, and joints of all placements."""

from __future__ import annotations

from hypothesis import strategies as st

small = st.floats(-1.0, 1.0).map(lambda x: round(x, 4))
sizes = st.floats(0.02, 0.5).map(lambda x: round(x, 4))
positive = st.floats(0.0, 3.0).map(lambda x: round(x, 4))
angles = st.floats(-180.0, 180.0).map(lambda x: round(x, 2))
classes = st.sampled_from(["", ' class="a"', ' class="b"', ' class="c"'])


def words(*values: float) -> str:
    return " ".join(repr(value) for value in values)


@st.composite
def vectors(draw, elements=small, size: int = 3) -> str:
    return words(*(draw(elements) for _ in range(size)))


@st.composite
def directions(draw) -> tuple[float, float, float]:
    """A vector of length 0.2 at least."""
    x, y, z = (draw(small) for _ in range(3))
    return (x, y, z) if x * x + y * y + z * z > 0.04 else (1.0, y, z)


@st.composite
def placements(draw) -> str:
    """`pos` and one orientation, either left out now and then."""
    place = f' pos="{draw(vectors())}"' if draw(st.booleans()) else ""
    kind = draw(st.sampled_from(["", "quat", "axisangle", "euler", "xyaxes", "zaxis"]))
    x, y, z = draw(directions())
    match kind:
        case "quat":
            return f'{place} quat="{words(draw(small), x, y, z)}"'
        case "axisangle":
            return f'{place} axisangle="{words(x, y, z, draw(angles))}"'
        case "euler":
            return f'{place} euler="{draw(vectors(angles))}"'
        case "xyaxes":  # y anywhere but along x
            return f'{place} xyaxes="{words(x, y, z, y + 0.3, z - 0.4, -x + 0.2)}"' if abs(x) < 0.1 else place
        case "zaxis":
            return f'{place} zaxis="{words(x, y, z)}"'
    return place


@st.composite
def geoms(draw) -> str:
    kind = draw(st.sampled_from(["sphere", "capsule", "cylinder", "box"]))
    mass = draw(st.sampled_from(["", ' mass="0.3"', ' density="200"']))
    attributes = f'type="{kind}"{mass}{draw(classes)}'
    if kind != "sphere" and draw(st.booleans()):
        start, direction = [draw(small) for _ in range(3)], draw(directions())
        end = [a + b for a, b in zip(start, direction, strict=True)]
        return f'<geom {attributes} size="{draw(sizes)}" fromto="{words(*start, *end)}"/>'
    return f'<geom {attributes} size="{draw(vectors(sizes))}"{draw(placements())}/>'


@st.composite
def joints(draw, name: str) -> str:
    kind = draw(st.sampled_from(["", ' type="hinge"', ' type="slide"']))
    parts = [f'name="{name}"{kind}{draw(classes)}', f'axis="{words(*draw(directions()))}"']
    for key in ("damping", "armature", "stiffness", "frictionloss"):
        if draw(st.booleans()):
            parts.append(f'{key}="{draw(positive)}"')
    for key in ("ref", "springref"):
        if draw(st.integers(0, 3)) == 0:
            parts.append(f'{key}="{draw(small)}"')
    if draw(st.booleans()):
        parts.append(f'pos="{draw(vectors())}"')
    if draw(st.booleans()):
        lower = draw(small)
        parts.append(f'range="{words(lower, lower + draw(sizes))}"')
    return f"<joint {' '.join(parts)}/>"


@st.composite
def bodies(draw, name: str, depth: int) -> str:
    """A body with up to three joints, a site and up to two bodies inside, some of it in a frame."""
    content = [draw(joints(f"{name}j{i}")) for i in range(draw(st.integers(0, 3)))]
    if draw(st.integers(0, 3)) == 0:
        content.append(f'<inertial pos="{draw(vectors())}" mass="0.7" diaginertia="0.02 0.03 0.04"/>')
    content.append(draw(geoms()))
    content.append(f'<site name="{name}s"{draw(placements())}/>')
    for i in range(draw(st.integers(0, 2)) if depth else 0):
        content.append(draw(bodies(f"{name}b{i}", depth - 1)))
    if draw(st.integers(0, 3)) == 0:
        content = [f"<frame{draw(placements())}>", *content, "</frame>"]
    childclass = draw(st.sampled_from(["", ' childclass="a"', ' childclass="c"']))
    return "\n".join([f'<body name="{name}"{childclass}{draw(placements())}>', *content, "</body>"])


@st.composite
def defaults(draw) -> str:
    inner = '<geom friction="0.5"/><joint damping="0.25" stiffness="2"/>'
    return (
        f'<default><geom density="{draw(sizes)}"/><joint armature="{draw(positive)}"/><motor ctrlrange="-1 1"/>'
        f'<default class="a"><joint damping="{draw(positive)}"/><default class="b"><geom density="700"/></default>'
        f'</default><default class="c">{inner}</default></default>'
    )


@st.composite
def texts(draw) -> str:
    """Whole files: free or fixed, in degrees or radians, with one of the sequences of Euler angles."""
    angle = draw(st.sampled_from(["degree", "radian"]))
    sequence = draw(st.sampled_from(["xyz", "ZYX", "zXz", "yxz"]))
    limbs = "\n".join(draw(bodies(f"b{i}", 2)) for i in range(draw(st.integers(1, 2))))
    free = draw(st.booleans())
    place = 'pos="0 0 0.7"' if free else draw(placements())
    joint = "<freejoint/>" if free else ""
    names = [part.split('"')[0] for part in limbs.split('site name="')[1:]]
    sensors = "".join(f'<accelerometer name="{name}" site="{name}"/>' for name in names)
    moving = [part.split('"')[0] for part in limbs.split('<joint name="')[1:]]
    motors = "".join(f'<motor name="{name}" joint="{name}" gear="{draw(sizes)}"/>' for name in moving[::2])
    return (
        f'<mujoco><compiler angle="{angle}" eulerseq="{sequence}"/>{draw(defaults())}<worldbody>\n'
        f'<body name="torso" {place}>{joint}<geom size="0.1"/>\n{limbs}</body></worldbody>\n'
        f"<actuator>{motors}</actuator><sensor>{sensors}</sensor></mujoco>"
    )
