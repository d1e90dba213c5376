"""The dependency rule and the habits that keep GUARD readable, checked on the source itself."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
CORE = ROOT / "guard_api"
PLUGINS = {
    "guard_mujoco": ROOT / "backends/mujoco/guard_mujoco",
    "guard_bullet": ROOT / "backends/bullet/guard_bullet",
    "guard_sapien": ROOT / "backends/sapien/guard_sapien",
    "guard_algos": ROOT / "algos/guard_algos",
}
ENGINES = {"mujoco", "pybullet", "sapien", "torch"}

# A package may import those below it in this list, never above.
LAYERS = [
    {"cli"},
    {"measure", "gym", "viewer"},
    {"env"},
    {"suite", "safety_gym", "specfile", "runs", "algorithm", "testing"},
    {"spec"},
    {"tasks", "constraints"},
    {"sensors"},
    {"scene", "model", "physics", "plugins"},
    {"rotations", "shapes", "conventions", "typed", "errors"},
]


def imported_modules(file: Path) -> set[str]:
    """Every module that `file` imports, at any depth of the code; typing-only imports excluded."""
    tree = ast.parse(file.read_text())
    skipped: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            skipped.update(child for statement in node.body for child in ast.walk(statement))
    found: set[str] = set()
    for node in ast.walk(tree):
        if node in skipped:
            continue
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def sources(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py"))


@pytest.mark.parametrize("file", sources(CORE), ids=lambda f: str(f.relative_to(ROOT)))
def test_core_imports_no_simulator_and_no_plugin(file: Path) -> None:
    roots = {name.split(".")[0] for name in imported_modules(file)}
    assert not roots & (ENGINES | set(PLUGINS))


@pytest.mark.parametrize("name", PLUGINS)
def test_plugins_never_import_each_other(name: str) -> None:
    others = (set(PLUGINS) - {name}) | (ENGINES - {_engine(name)})
    for file in sources(PLUGINS[name]):
        roots = {module.split(".")[0] for module in imported_modules(file)}
        assert not roots & others, file


def _engine(plugin: str) -> str:
    return {"guard_mujoco": "mujoco", "guard_bullet": "pybullet", "guard_sapien": "sapien", "guard_algos": "torch"}[
        plugin
    ]


@pytest.mark.parametrize("file", sources(CORE), ids=lambda f: str(f.relative_to(ROOT)))
def test_core_layers_import_downwards(file: Path) -> None:
    depth = {package: level for level, packages in enumerate(LAYERS) for package in packages}
    own = file.relative_to(CORE).parts[0].removesuffix(".py")
    if own == "__init__":
        return
    for module in imported_modules(file):
        parts = module.split(".")
        if parts[0] == "guard_api" and len(parts) > 1 and parts[1] in depth:
            assert depth[parts[1]] >= depth[own], f"{file.name} ({own}) imports {module}, which lies above it"


def test_no_file_asks_which_backend_runs() -> None:
    for folder in (CORE, PLUGINS["guard_algos"]):
        for file in sources(folder):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Compare):
                    text = ast.unparse(node)
                    names = [c.value for c in ast.walk(node) if isinstance(c, ast.Constant)]
                    asks = "backend" in text and {"mujoco", "bullet", "sapien"} & {
                        n for n in names if isinstance(n, str)
                    }
                    assert not asks, f"{file}: {text}"


def test_no_global_random_numbers() -> None:
    allowed = {"default_rng", "Generator", "PCG64", "SeedSequence", "Philox"}
    for folder in (CORE, *PLUGINS.values()):
        for file in sources(folder):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Attribute) and ast.unparse(node.value) in {"np.random", "numpy.random"}:
                    assert node.attr in allowed, f"{file}: np.random.{node.attr}"


def test_backend_folders_do_not_shadow_their_engines() -> None:
    for engine in ("mujoco", "bullet", "sapien"):
        assert not (ROOT / "backends" / engine / "__init__.py").exists()


@pytest.mark.parametrize("file", [f for d in (CORE, *PLUGINS.values()) for f in sources(d)], ids=lambda f: f.name)
def test_files_stay_small(file: Path) -> None:
    assert len(file.read_text().splitlines()) <= 300


def test_names_say_something() -> None:
    empty = {"utils", "util", "common", "helpers", "helper", "misc", "manager"}
    for folder in (CORE, *PLUGINS.values(), ROOT / "tests"):
        for file in sources(folder):
            assert not empty & {file.stem, *file.relative_to(ROOT).parts}, file


def test_importing_the_core_loads_no_engine() -> None:
    code = (
        "import sys, guard_api, guard_api.plugins, guard_api.env; "
        f"print(','.join(sorted(set(sys.modules) & {ENGINES!r})))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == ""
