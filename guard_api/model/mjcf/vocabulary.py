"""The words of MJCF: those that are read, those that are listed as left out, and those that are refused."""

from __future__ import annotations

from guard_api.model.element import Element
from guard_api.model.mjcf.placement import ORIENTATIONS
from guard_api.model.mjcf.sensors import KINDS
from guard_api.model.problems import Problems
from guard_api.model.vocabulary import Words, check_vocabulary, known_elements

_REFUSED = {
    "include": "put the included elements into this file",
    "attach": "put the attached bodies into this file",
    "replicate": "write the copies out",
    "composite": "write its bodies out",
    "flexcomp": "deformable bodies are not supported",
    "plugin": "plugins of MuJoCo are not supported",
}
"""Elements without which the file would describe another robot, and the remedy."""

_LABELS = ("name", "class", "group", "user")
_PLACE = ("pos", *ORIENTATIONS)
_ACTUATOR = (
    *_LABELS, "joint", "jointinparent", "site", "tendon", "body", "cranksite", "slidersite", "refsite", "gear",
    "ctrlrange", "ctrllimited", "forcerange", "forcelimited", "armature", "damping", "delay",
)  # fmt: skip
_ACTUATOR_IGNORED = ("cranklength", "lengthrange", "interp", "nsample", "actlimited", "actrange", "actearly")
_ACTUATOR_KINDS = (
    "intvelocity", "orientation", "pid", "damper", "cylinder", "muscle", "adhesion", "dcmotor", "plugin",
)  # fmt: skip
_SENSOR = Words(
    ("name", "site", "joint", "cutoff", "user"), ignored=("delay", "interp", "interval", "noise", "nsample")
)
_OTHER_SENSORS = (
    "force", "torque", "camprojection", "rangefinder", "tendonpos", "tendonvel", "actuatorpos", "actuatorvel",
    "actuatorfrc", "jointactuatorfrc", "tendonactuatorfrc", "jointlimitpos", "jointlimitvel", "jointlimitfrc",
    "tendonlimitpos", "tendonlimitvel", "tendonlimitfrc", "framepos", "framequat", "framexaxis", "frameyaxis",
    "framezaxis", "framelinvel", "frameangvel", "framelinacc", "frameangacc", "subtreecom", "subtreelinvel",
    "subtreeangmom", "insidesite", "distance", "normal", "fromto", "contact", "e_potential", "e_kinetic", "clock",
    "tactile", "user", "plugin",
)  # fmt: skip
_IN_BODY = ("inertial", "joint", "freejoint", "geom", "site", "body", "frame")
_NOT_IN_BODY = ("camera", "light")

MJCF = {
    "mujoco": Words(
        ("model",),
        ("compiler", "option", "default", "asset", "worldbody", "contact", "tendon", "equality", "actuator", "sensor",
         "keyframe"),
        ("size", "statistic", "visual", "extension", "deformable", "custom"),
    ),
    "compiler": Words(
        ("angle", "autolimits", "boundmass", "boundinertia", "coordinate", "eulerseq", "inertiafromgeom",
         "inertiagrouprange", "meshdir", "assetdir", "texturedir", "settotalmass", "strippath"),
        ("lengthrange",),
        ("alignfree", "balanceinertia", "conflict", "discardvisual", "fitaabb", "fusestatic", "passthrough",
         "savecanonical", "savecompiled", "saveinertial", "usethread", "convexhull", "exactmeshinertia"),
    ),
    "lengthrange": Words(),
    "option": Words(
        ("timestep",),
        ("flag",),
        ("actuatorgroupdisable", "ccd_iterations", "ccd_tolerance", "cone", "density", "gravity", "impratio",
         "integrator", "iterations", "jacobian", "ls_iterations", "ls_tolerance", "magnetic", "noslip_iterations",
         "noslip_tolerance", "o_friction", "o_margin", "o_solimp", "o_solref", "sdf_initpoints", "sdf_iterations",
         "sleep_tolerance", "solver", "tolerance", "viscosity", "wind"),
    ),
    "flag": Words(),
    "default": Words(
        ("class",),
        ("default", "joint", "geom", "site", "mesh", "material", "general", "motor", "position", "velocity"),
        ("texture", "camera", "light", "pair", "equality", "tendon", *_ACTUATOR_KINDS),
    ),
    "asset": Words((), ("mesh", "material"), ("hfield", "skin", "texture", "model")),
    "mesh": Words(
        ("name", "class", "file", "scale", "refpos", "refquat", "inertia", "vertex", "builtin"),
        (),
        ("content_type", "face", "material", "maxhullvert", "normal", "params", "smoothnormal", "texcoord"),
    ),
    "material": Words(
        ("name", "class", "rgba"),
        (),
        ("layer", "emission", "metallic", "reflectance", "roughness", "shininess", "specular", "texrepeat", "texture",
         "texuniform"),
    ),
    "worldbody": Words((), ("body", "frame"), ("geom", "site", *_NOT_IN_BODY)),
    "frame": Words(("name", "childclass", *_PLACE), _IN_BODY, _NOT_IN_BODY),
    "body": Words(
        ("name", "childclass", "gravcomp", "mocap", "user", *_PLACE),
        _IN_BODY,
        (*_NOT_IN_BODY, "fuse", "simple", "sleep"),
    ),
    "inertial": Words(("mass", "diaginertia", "fullinertia", *_PLACE)),
    "joint": Words(
        (*_LABELS, "type", "pos", "axis", "range", "limited", "damping", "armature", "stiffness", "springref",
         "frictionloss", "ref", "springdamper", "actuatorfrcrange", "actuatorfrclimited"),
        (),
        ("actuatorgravcomp", "margin", "solimpfriction", "solimplimit", "solreffriction", "solreflimit",
         "springyield"),
    ),
    "freejoint": Words(("name", "group"), (), ("align",)),
    "geom": Words(
        (*_LABELS, "type", "size", "fromto", "mass", "density", "contype", "conaffinity", "friction", "rgba",
         "material", "mesh", "shellinertia", *_PLACE),
        (),
        ("adhesion", "castshadow", "condim", "fitscale", "fluidcoef", "fluidshape", "gap", "hfield", "margin",
         "priority", "solimp", "solmix", "solref", "surfacevel"),
    ),
    "site": Words((*_LABELS, "type", "size", "fromto", "rgba", "material", *_PLACE), (), ("mesh",)),
    "contact": Words(ignored=("pair", "exclude")),
    "tendon": Words(ignored=("spatial", "fixed")),
    "equality": Words(ignored=("connect", "weld", "joint", "tendon", "flex", "flexstrain")),
    "keyframe": Words(ignored=("key",)),
    "actuator": Words((), ("general", "motor", "position", "velocity"), _ACTUATOR_KINDS),
    "motor": Words(_ACTUATOR, ignored=_ACTUATOR_IGNORED),
    "position": Words(
        (*_ACTUATOR, "kp", "kv", "dampratio", "timeconst", "inheritrange"), ignored=_ACTUATOR_IGNORED
    ),
    "velocity": Words((*_ACTUATOR, "kv"), ignored=_ACTUATOR_IGNORED),
    "general": Words(
        (*_ACTUATOR, "actdim", "biasprm", "biastype", "dyntype", "gainprm", "gaintype", "inheritrange"),
        (),
        (*_ACTUATOR_IGNORED, "dynprm", "ffrange", "input", "velrange"),
    ),
    "sensor": Words((), tuple(KINDS), _OTHER_SENSORS),
    **dict.fromkeys(KINDS, _SENSOR),
}  # fmt: skip


def check_words(root: Element, problems: Problems) -> None:
    """Report misspelt words and refused elements as errors, and list what is left out, once for each word."""
    for element in known_elements(root, MJCF):
        for child in element.children():
            if child.tag in _REFUSED:
                child.error(f"<{child.tag}> is not supported: {_REFUSED[child.tag]}")
            elif element.tag == "equality" and child.attributes.get("active") != "false":
                child.error(
                    f"<{child.tag}> in <equality> is not supported, every joint moves by itself: "
                    'remove it, or set active="false"'
                )
    check_vocabulary(root, problems, MJCF, "MJCF")
