"""Imports point down only.

gimpmd -> deploy -> strain -> schemas; md, gimp -> participant -> schemas.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "gimpmd_schemas": ROOT / "schemas/gimpmd_schemas",
    "gimpmd_coupler": ROOT / "services/coupler/gimpmd_coupler",
    "gimpmd_strain": ROOT / "services/md/gimpmd_strain",
    "gimpmd_md": ROOT / "services/md/gimpmd_md",
    "gimpmd_gimp": ROOT / "services/gimp/gimpmd_gimp",
    "gimpmd_deploy": ROOT / "deploy/gimpmd_deploy",
    "gimpmd": ROOT / "deploy/gimpmd",
}
SCHEMAS = "gimpmd_schemas"
CLIENT = tuple(
    f"gimpmd_coupler.{module}" for module in ("arguments", "participant", "loop", "exit")
)
ALLOWED = {
    "gimpmd_schemas": (),
    "gimpmd_coupler": (SCHEMAS,),
    "gimpmd_strain": (SCHEMAS,),
    "gimpmd_md": (SCHEMAS, "gimpmd_strain", *CLIENT),
    "gimpmd_gimp": (SCHEMAS, *CLIENT),
    "gimpmd_deploy": (SCHEMAS, "gimpmd_strain"),
    "gimpmd": (SCHEMAS, "gimpmd_deploy"),
}
"""Modules of other packages that a package may import, with what lies below them."""


def package_of(module: str) -> str:
    """Top-level package of a module."""
    return module.split(".", maxsplit=1)[0]


def imports(path: Path) -> Iterator[tuple[str, str | None]]:
    """All imports of a file, also those inside functions: module, and name taken from it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from ((node.module or "", alias.name) for alias in node.names)


def is_module(module: str) -> bool:
    """Whether a dotted name is one of our modules."""
    package, *rest = module.split(".")
    place = PACKAGES[package].joinpath(*rest)
    return place.with_suffix(".py").exists() or place.is_dir()


def resolved(module: str, name: str | None) -> str:
    """Module that an import reaches: ``from package import module`` reaches the module."""
    whole = f"{module}.{name}"
    return whole if name and package_of(module) in PACKAGES and is_module(whole) else module


FILES = [
    pytest.param(package, path, id=str(path.relative_to(ROOT)))
    for package, folder in PACKAGES.items()
    for path in sorted(folder.rglob("*.py"))
]


def test_every_package_has_modules() -> None:
    assert {param.values[0] for param in FILES} == set(PACKAGES)


@pytest.mark.parametrize(("package", "path"), FILES)
def test_imports_point_down(package: str, path: Path) -> None:
    for module, name in imports(path):
        target = resolved(module, name)
        if package_of(target) in PACKAGES and package_of(target) != package:
            below = [a for a in ALLOWED[package] if target == a or target.startswith(f"{a}.")]
            assert below, f"{path.relative_to(ROOT)} imports {target}"


@pytest.mark.parametrize(("package", "path"), FILES)
def test_private_names_stay_inside(package: str, path: Path) -> None:
    for module, name in imports(path):
        if package_of(module) in PACKAGES and package_of(module) != package:
            parts = [*module.split("."), name or ""]
            private = [part for part in parts if part.startswith("_")]
            assert not private, f"{path.relative_to(ROOT)} imports {module}.{name}"


@pytest.mark.parametrize(("package", "path"), FILES)
def test_zenoh_is_seen_by_the_bus_alone(package: str, path: Path) -> None:
    if path.parent != PACKAGES["gimpmd_coupler"] / "bus":
        assert "zenoh" not in {package_of(module) for module, _ in imports(path)}


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_are_typed(package: str) -> None:
    assert (PACKAGES[package] / "py.typed").exists()


def test_the_rules_notice_a_breach(tmp_path: Path) -> None:
    """The helpers see imports of every form, inside functions too."""
    path = tmp_path / "bad.py"
    path.write_text(
        "def f():\n    from gimpmd_coupler import bus\n    import gimpmd_md.coupling.halo\n"
        "from gimpmd_gimp.step.solver import _x\n"
    )
    found = {resolved(module, name) for module, name in imports(path)}
    assert found == {"gimpmd_coupler.bus", "gimpmd_md.coupling.halo", "gimpmd_gimp.step.solver"}
