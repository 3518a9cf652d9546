"""Meaning of a case: every rule has a case that breaks it, and one that just keeps it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimpmd_schemas.case.checks.check import HUGE, cautions, check_case, check_stability
from gimpmd_schemas.case.form import Case

Make = Callable[..., Case]
LEFT = {"condition": "traction", "value": [1, 0]}
MEASURED = {"from": "md", "cell": "cell.in"}


def crack(x: float, y: float = 40.0) -> list[dict[str, Any]]:
    """A crack from the left face to a point."""
    return [{"from": [0, 40], "to": [x, y]}]


def packet(**changes: Any) -> list[dict[str, Any]]:
    """A packet with changes."""
    return [{"center": 60, "wavelength": 10, "strain": 1e-4} | changes]


def material(**changes: Any) -> dict[str, Any]:
    """The sound material with changes."""
    return {"from": "moduli", "density": 0.93, "lame": 27.8, "shear": 27.8} | changes


def crystal(**changes: Any) -> dict[str, Any]:
    """A strain energy of degree three, which has 16 terms."""
    energy = {"from": "hyperelastic", "coefficients": [1.0] * 16, "strain_limit": 0.06}
    return material(**energy | changes)


def bonded(**changes: Any) -> dict[str, Any]:
    """A material of two bonds."""
    bonds = {
        "bonds": [[1, 0], [0, 1]],
        "energy": [[0, 1], [0, 1, 2]],
        "area": 1,
        "stretch_limit": 0.1,
    }
    return {"continuum__material": material(**{"from": "lattice"} | bonds | changes)}


ALONE: dict[str, Any] = {"only": "continuum", "md": ..., "time": {"end": 8}}
"""Changes that take the atoms away: what is left is 30 x 20 cells of 4."""

BLOCK = ALONE | {"domain__box": [[0, 40], [0, 40], [0, 24]]}
"""The same in three dimensions: 10 x 10 x 6 cells."""

STIFF = [[100, 30, 0], [30, 80, 0], [0, 0, 25]]
ENDS = {"from": [0, 40], "to": [60, 40]}


def levels(*boxes: list[Any]) -> dict[str, Any]:
    """A body alone with one list of boxes for each refined level."""
    return ALONE | {"grid__levels": [{"boxes": level} for level in boxes]}


def cracked(base: dict[str, Any] = ALONE, **changes: Any) -> dict[str, Any]:
    """A body alone with a crack from the left face to its middle, with changes."""
    return base | {"continuum__cracks": [ENDS | changes]}


def face(**changes: Any) -> dict[str, Any]:
    """A body alone with a condition on its left face."""
    return ALONE | {"boundary__left": changes}


def anisotropic(stiffness: list[list[float]]) -> dict[str, Any]:
    """A material given by its stiffness."""
    return {"continuum__material": {"from": "stiffness", "density": 1, "stiffness": stiffness}}


FORCED = {"coupling__scheme": "force"}
FIXED = ALONE | {"continuum__configuration": "reference"}
CORRECTED = FIXED | {"continuum__dispersion": "corrected"}
SLANTED = [[100, 30, 5], [30, 80, 5], [5, 5, 25]]  # a P wave along x moves along y as well

FORCE = {"coupling__scheme": "force"}
"""The sound case by the force scheme: interfaces right, bottom and top."""


def regions(*boxes: Any) -> dict[str, Any]:
    """Several MD regions instead of the one."""
    return {"md__region": ..., "md__regions": list(boxes)}


PAIR = ([[0, 40], [18, 58]], [[80, 120], [18, 58]])
"""Two regions, on the left and on the right face of the domain; cells are 4."""

ABSORBING = {"boundary__right": {"condition": "absorbing"}}


def planes(**changes: Any) -> dict[str, Any]:
    """The same with planes, four deep in the MD region [0, 80] x [20, 60]."""
    return FORCE | {"coupling__planes": {"right": 76, "bottom": 24, "top": 56} | changes}


# cell 4, two layers a cell: outer 4, inner 14; innermost at depth 18
BREAKS: list[tuple[str, dict[str, Any], str]] = [
    ("grid.cell", {"grid__cell": 0.0}, "must be positive"),
    ("grid.cell", {"grid__cell": float("nan")}, "must be a number between"),
    ("time.end", {"time__end": float("inf")}, "must be a number between"),
    ("time.end", {"time__end": 2 * HUGE}, "must be a number between"),
    ("time.md_timestep", {"time__md_timestep": 0.5 / HUGE}, "must be a number between"),
    ("md.variables.a", {"md__variables": {"a": float("nan")}}, "must be a number between"),
    ("boundary.top.value[1]", {"boundary__top": LEFT | {"value": [0, float("inf")]}}, "between"),
    ("time.end", {"time__end": -1}, "must be positive"),
    ("time.md_timestep", {"time__md_timestep": 0}, "must be positive"),
    ("time.md_steps", {"time__md_steps": 0}, "must be positive"),
    ("output.interval", {"output__interval": 0}, "must be positive"),
    ("output.energy_interval", {"output__energy_interval": -1}, "must be positive"),
    ("grid.points_per_axis", {"grid__points_per_axis": 0}, "must be positive"),
    ("grid.points_per_axis", {"grid__points_per_axis": 5}, "must be 1, 2, 3 or 4"),
    ("md.ranks", {"md__ranks": 0}, "must be positive"),
    ("md.ranks", {"md__ranks": 201}, "more than the 200 cells"),
    ("md.ranks", {"md__ranks": 2**62}, "more than the 200 cells"),
    ("md.cutoff", {"md__cutoff": 0}, "must be positive"),
    ("continuum.ranks", {"continuum__ranks": 601}, "more than the 600 cells"),
    ("continuum.ranks", {"continuum__ranks": 0}, "must be positive"),
    ("continuum.threads", {"continuum__threads": 0}, "must be positive"),
    ("continuum.xpic.order", {"continuum__xpic__order": 0}, "must be at least 1"),
    ("continuum.xpic.every", {"continuum__xpic__every": -1}, "must not be negative"),
    ("continuum.material.density", {"continuum__material": material(density=0)}, "positive"),
    ("continuum.material.shear", {"continuum__material": material(shear=0)}, "positive"),
    ("continuum.material.lame", {"continuum__material": material(lame=-27.8)}, "must exceed"),
    (
        "continuum.material.strain_limit",
        {"continuum__material": crystal(strain_limit=0)},
        "positive",
    ),
    (
        "continuum.material.coefficients",
        {"continuum__material": crystal(coefficients=[1.0] * 15)},
        "not those of a polynomial in 3 strains",
    ),
    ("coupling.zones.outer", {"coupling__zones__outer": 0}, "must be positive"),
    ("coupling.zones.inner", {"coupling__zones__inner": -1}, "must be positive"),
    ("coupling.zones.filter", {"coupling__zones__filter": 0}, "must be positive"),
    ("coupling.zones.incommunicado", {"coupling__zones__incommunicado": -0.1}, "negative"),
    ("coupling.filter_rate", {"coupling__filter_rate": -1}, "must not be negative"),
    (
        "coupling.filter_rate",
        {"coupling__scheme": "paper", "coupling__filter_rate": 1.0},
        "which the scheme paper does not have",
    ),
    (
        "coupling.zones.filter",
        {"coupling__scheme": "paper", "coupling__zones__filter": 8.0},
        "which the scheme paper does not have",
    ),
    ("name", {"name": ""}, "folder's name"),
    ("name", {"name": "../up"}, "folder's name"),
    ("name", {"name": ".hidden"}, "folder's name"),
    ("name", {"name": "a/b"}, "folder's name"),
    ("name", {"name": "a*"}, "folder's name"),
    ("domain.box", {"domain__box": [[0, 120], [80, 0]]}, "upper y is not above lower y"),
    ("md.region", {"md__region": [[80, 0], [20, 60]]}, "upper x is not above lower x"),
    ("grid.cell", {"grid__cell": 7}, "does not divide the domain along x"),
    ("grid.cell", {"grid__cell": 1e-3}, "makes 9.6e+09 cells"),
    ("md.region", {"md__region": [[-1, 80], [20, 60]]}, "leaves the domain along x"),
    ("md.region", {"domain__periodic": [False, True]}, "must span the whole domain"),
    ("md.region", {"md__region": ...}, "missing"),
    ("md.regions", {"md__regions": [[[0, 16], [20, 60]]]}, "comes beside md.region"),
    ("md.regions[1]", regions([[0, 40], [20, 60]], [[60, 121], [20, 60]]), "leaves the domain"),
    (
        "md.regions[1]",
        regions([[0, 60], [20, 60]], [[50, 100], [30, 60]]),
        "overlaps md.regions[0]",
    ),
    ("md.regions[1]", regions([[0, 50], [20, 60]], [[81, 100], [20, 60]]), "within 31 of md.regi"),
    (
        "md.regions[1]",
        regions([[0, 40], [20, 60]], [[88, 113], [20, 60]]),
        "within 7 of the domain",
    ),
    ("md.regions[2]", regions(*PAIR, [[0, 40], [66, 80]]), "comes within 8 of md.regions[0]"),
    ("coupling.zones", regions(PAIR[0], [[80, 100], [20, 60]]), "do not fit the MD region along x"),
    ("md.regions[1]", regions(*PAIR) | {"domain__periodic": [False, True]}, "must span the whole"),
    (
        "md.regions[1]",
        FORCE | {"md__cutoff": 2.5} | regions(PAIR[0], [[80, 92.9], [20, 52]]),
        "is 12.9 wide along x; ghost atoms",
    ),
    (
        "coupling.planes",
        FORCE | regions(*PAIR) | {"coupling__planes": {"right": 36, "bottom": 24, "top": 48}},
        "are not the planes of 2 MD regions",
    ),
    (
        "coupling.planes[1].left",
        FORCE
        | regions(*PAIR)
        | {
            "coupling__planes": [
                {"right": 36, "bottom": 24, "top": 48},
                {"bottom": 24, "top": 48},
            ]
        },
        "missing at an interface",
    ),
    (
        "continuum.cracks[0]",
        regions(*PAIR) | {"continuum__cracks": [{"from": [10, 38], "to": [110, 38]}]},
        "reaches the zones",
    ),
    ("boundary.right.condition", regions(*PAIR) | ABSORBING, "is not known to the atoms"),
    (
        "grid.levels",
        regions(*PAIR) | {"grid__levels": [{"boxes": [[[0, 64], [0, 80]]]}]},
        "no box of the finest level holds the MD region",
    ),
    ("time.end", {"time__end": 0.0019}, "comes before the first MD step"),
    ("md.region", {"md__region": [[0, 120], [0, 80]]}, "nothing to couple"),
    ("coupling.absorber", {"coupling__absorber": {"rate": 1}}, "belongs to the force scheme"),
    ("coupling.absorber.rate", {"coupling__absorber": {"rate": 0}}, "must be positive"),
    (
        "coupling.absorber.width",
        {"coupling__absorber": {"rate": 1, "width": 0}},
        "must be positive",
    ),
    (
        "coupling.absorber.temperature",
        {"coupling__absorber": {"rate": 1, "temperature": -1}},
        "must not be negative",
    ),
    (
        "coupling.absorber.seed",
        {"coupling__absorber": {"rate": 1, "seed": -1}},
        "must not be negative",
    ),
    (
        "coupling.absorber.rate",
        {"coupling__scheme": "force", "coupling__absorber": {"rate": 100}},
        "more than all motion",
    ),
    ("coupling.zones.outer", {"md__cutoff": 4.01}, "narrower than the potential's cutoff"),
    ("continuum.integrator", {"continuum__integrator": "usavg"}, "does not fit the velocity"),
    ("coupling.zones.inner", {"coupling__zones__inner": 7.9}, "narrower than four layers"),
    ("coupling.zones", {"md__region": [[0, 80], [22, 58]]}, "do not fit the MD region along y"),
    ("md.region", {"md__region": [[0, 80], [20, 72.1]]}, "within 7.9 of the domain's top face"),
    ("boundary.left.ramp", {"boundary__left": LEFT | {"ramp": -1}}, "must not be negative"),
    ("boundary.left.value", {"boundary__left": {"condition": "traction"}}, "needs a value"),
    ("boundary.left.value", {"boundary__left": {"condition": "velocity"}}, "needs a value"),
    ("boundary.left.value", {"boundary__left": {"value": [1, 0]}}, "takes no value"),
    (
        "boundary.left.value",
        {"boundary__left": {"condition": "symmetry", "value": [0, None]}},
        "takes no value",
    ),
    (
        "boundary.top.condition",
        {
            "domain__periodic": [False, True],
            "md__region": [[0, 80], [0, 80]],
            "boundary__top": {"condition": "symmetry"},
        },
        "periodic axis",
    ),
    ("md.patches", {"md__ranks": 4, "md__patches": [3, 1]}, "3 x 1 = 3"),
    ("md.patches", {"md__ranks": 4, "md__patches": [-2, -2]}, "do not tile"),
    ("continuum.cracks[0]", {"continuum__cracks": crack(0)}, "has no length"),
    ("continuum.cracks[0]", {"continuum__cracks": crack(-1)}, "leaves the domain"),
    ("continuum.cracks[0]", {"continuum__cracks": crack(62)}, "reaches the zones"),
    ("initial.packets[0].wavelength", {"initial__packets": packet(wavelength=0)}, "positive"),
    ("initial.packets[0].cycles", {"initial__packets": packet(cycles=0)}, "positive"),
    ("initial.packets[0].center", {"initial__packets": packet(center=121)}, "leaves the domain"),
    ("initial.packets[0].center", {"initial__packets": packet(center=81, axis=1)}, "leaves"),
    ("initial.packets[0].tilt", {"initial__packets": packet(tilt=81)}, "between -80 and 80"),
    (
        "initial.stretch.gradient",
        {"initial__stretch": {"gradient": [[0.2, 0], [0, 0]]}},
        "must be less than 0.2",
    ),
    (
        "initial.stretch.gradient",
        ALONE
        | {"domain__periodic": [False, True]}
        | {"initial__stretch": {"gradient": [[0, 0.01], [0, 0]]}},
        "displaces one end of the period along y",
    ),
    (
        "initial.stretch.center",
        {"initial__stretch": {"gradient": [[0.01, 0], [0, 0]], "center": [1, 2, 3]}},
        "must have 2 entries",
    ),
    (
        "initial.packets[0].tilt",
        ALONE | {"domain__periodic": [False, True], "initial__packets": packet(tilt=20)},
        "makes 2.73616 waves over the period along y, no whole number",
    ),
    (
        "initial.packets[0].tilt",
        ALONE | anisotropic(STIFF) | {"initial__packets": packet(tilt=30)},
        "wants an isotropic body",
    ),
    ("time.md_steps", {"time__md_steps": 212}, "c dt / h"),
    # sides and dimensions
    ("md", {"md": ..., "time": {"end": 8}}, "missing, and the run has atoms"),
    ("md", ALONE | {"only": "md"}, "missing, and the run has atoms"),
    ("time.md_timestep", {"time__md_timestep": ...}, "missing"),
    ("time.md_timestep", ALONE | {"time": {"end": 8, "md_timestep": 1e-3}}, "has no md"),
    ("time.md_steps", ALONE | {"time": {"end": 8, "md_steps": 4}}, "has no md"),
    ("time.step", {"time__step": 0.08}, "is set by the atoms"),
    ("time.step", ALONE | {"time": {"end": 8, "step": 0.0}}, "must be positive"),
    ("time.step", ALONE | {"time": {"end": 8, "step": 0.43}}, "c dt / h"),
    ("time.step", levels([[[16, 40], [16, 40]]]) | {"time": {"end": 8, "step": 0.22}}, "c dt / h"),
    ("domain.box", {"domain__box": [[0, 120], [0, 80], [0, 8]]}, "three-dimensional"),
    ("domain.box", {"domain__box": [[0, 120], [0, 80], [0, 8]], "only": "md"}, "three-dim"),
    ("domain.periodic", {"domain__periodic": [True]}, "must have 2 entries"),
    ("domain.periodic", BLOCK | {"domain__periodic": [True, True]}, "must have 3 entries"),
    ("md.region", {"md__region": [[0, 80], [20, 60], [0, 1]]}, "must have 2 entries"),
    ("domain.box", BLOCK | {"domain__box": [[0, 40], [0, 40], [24, 0]]}, "upper z is not above"),
    ("grid.cell", BLOCK | {"grid__cell": 5}, "does not divide the domain along z"),
    ("grid.levels[0].boxes[0]", levels([[[16, 40]] * 3]), "must have 2 entries"),
    ("continuum.cracks[0].from", cracked(**{"from": [0, 0, 0]}), "must have 2 entries"),
    ("continuum.cracks[0].along", cracked(BLOCK, along=[0, 4]), "must have 3 entries"),
    ("continuum.damping[0].box", ALONE | {"continuum__damping": [{"box": [[0, 1]] * 3}]}, "2 ent"),
    ("boundary.left.value", face(condition="traction", value=[1, 0, 0]), "must have 2 entries"),
    (
        "continuum.body_force.acceleration",
        BLOCK | {"continuum__body_force": {"acceleration": [0, -1]}},
        "must have 3 entries",
    ),
    (
        "initial.velocities[0].gradient[1]",
        ALONE | {"initial__velocities": [{"velocity": [0, 0], "gradient": [[0, 0], [0, 0, 0]]}]},
        "must have 2 entries",
    ),
    ("boundary.front", ALONE | {"boundary__front": {"condition": "symmetry"}}, "no front face"),
    ("initial.packets[0].axis", ALONE | {"initial__packets": packet(axis=2)}, "no z axis"),
    # levels
    ("grid.levels", levels(*[[[[0, 120], [0, 80]]]] * 8), "makes 9 levels, more than 8"),
    ("grid.levels[0].boxes", levels([]), "holds no box"),
    ("grid.levels[0].boxes[0]", levels([[[40, 16], [16, 40]]]), "upper x is not above"),
    ("grid.levels[0].boxes[0]", levels([[[16, 40], [16, 42]]]), "y faces miss the node lines"),
    ("grid.levels[0].boxes[0]", levels([[[16, 20], [16, 40]]]), "is 2 of its cells wide along x"),
    ("grid.levels[0].boxes[0]", levels([[[12, 40], [16, 40]]]), "does not lie inside a box"),
    ("grid.levels[0].boxes[0]", levels([[[16, 124], [16, 40]]]), "does not lie inside a box"),
    (
        "grid.levels[1].boxes[0]",
        levels([[[16, 64], [16, 64]]], [[[22, 40], [24, 40]]]),
        "does not lie inside a box of level 1",
    ),
    (  # inside level 1's two boxes together, in neither alone
        "grid.levels[1].boxes[0]",
        levels([[[16, 40], [16, 64]], [[56, 80], [16, 64]]], [[[32, 64], [32, 40]]]),
        "does not lie inside a box of level 1",
    ),
    (  # touches the domain's face, level 1 does not
        "grid.levels[1].boxes[0]",
        levels([[[16, 64], [0, 64]]], [[[0, 40], [0, 40]]]),
        "does not lie inside",
    ),
    (  # reaches one end of a periodic axis
        "grid.levels[0].boxes[0]",
        levels([[[16, 40], [0, 40]]]) | {"domain__periodic": [False, True]},
        "does not lie inside",
    ),
    (
        "grid.levels[0].boxes[1]",
        levels([[[16, 40], [16, 40]], [[52, 80], [16, 40]]]),
        "comes closer to it than 4 cells of level 0",
    ),
    ("grid.levels[0].boxes[1]", levels([[[16, 40], [16, 40]]] * 2), "overlaps box 0"),
    ("grid.cell", BLOCK | {"grid__cell": 1 / 32}, "makes 1.26e+09 cells"),
    (  # region, filter 4 and 4 cells of 2 need [0, 92] x [8, 72]
        "grid.levels",
        {"grid__levels": [{"boxes": [[[0, 88], [0, 80]]]}]},
        "no box of the finest level holds the MD region",
    ),
    # patches
    ("continuum.ranks", ALONE | {"continuum__ranks": 601}, "more than the 600 cells of level 0"),
    (
        "continuum.patches",
        ALONE | {"continuum__ranks": 4, "continuum__patches": [3, 1]},
        "3 x 1 = 3",
    ),
    (
        "continuum.patches",
        ALONE | {"continuum__ranks": 31, "continuum__patches": [31, 1]},
        "more than the 30 x 20 cells",
    ),
    ("continuum.patches", ALONE | {"continuum__ranks": 37}, "more than the 30 x 20 cells"),
    ("continuum.patches", BLOCK | {"continuum__patches": [1, 1]}, "must have 3 entries"),
    # material
    ("continuum.material.from", BLOCK | {"continuum__material": MEASURED}, "in two dimensions"),
    (
        "continuum.material.lame",
        BLOCK | {"continuum__material": material(lame=-20)},
        "must exceed -18.5333, minus 2/3",
    ),
    (
        "continuum.material.lame",
        {"continuum__material": material(lame=-20, plane="stress")},
        "must exceed -18.5333",
    ),
    ("continuum.material.plane", BLOCK | {"continuum__material": material(plane="stress")}, "two"),
    (
        "continuum.material.plane",
        {"continuum__material": material(plane="stress", model="neo-hookean")},
        "linear elasticity alone",
    ),
    (
        "continuum.material.shear",
        {"continuum__material": crystal(shear=0)},
        "must be positive",
    ),
    ("continuum.material.stiffness", anisotropic(STIFF[:2]), "3 rows of 3 numbers"),
    ("continuum.material.stiffness", BLOCK | anisotropic(STIFF), "6 rows of 6 numbers"),
    ("continuum.material.stiffness", anisotropic([[1, 2, 0], [0, 1, 0], [0, 0, 1]]), "symmetric"),
    ("continuum.material.stiffness", anisotropic([[1, 2, 0], [2, 1, 0], [0, 0, 1]]), "definite"),
    ("continuum.material.stiffness", anisotropic([[0, 0, 0]] * 3), "definite"),
    (
        "initial.packets[0].polarization",
        ALONE | anisotropic(SLANTED) | {"initial__packets": packet()},
        "is no wave of this stiffness along x",
    ),
    ("continuum.material.area", bonded(area=0), "must be positive"),
    ("continuum.material.stretch_limit", bonded(stretch_limit=-0.1), "must be positive"),
    ("continuum.material.shear", bonded(shear=0), "must be positive"),
    ("continuum.material.bonds", bonded(bonds=[[1, 0], [0, 0]]), "have a length"),
    ("continuum.material.bonds", bonded(bonds=[], energy=[]), "have a length"),
    ("continuum.material.energy", bonded(energy=[[0, 1]]), "for each of 2 bonds"),
    ("continuum.material.energy", bonded(energy=[[0, 1], []]), "for each of 2 bonds"),
    ("continuum.material.from", BLOCK | bonded(), "two dimensions alone"),
    ("continuum.temperature", bonded() | {"continuum__temperature": -1}, "must not be negative"),
    ("continuum.temperature", {"continuum__temperature": 0.05}, "needs the bonds"),
    (
        "continuum.temperature",
        {"continuum__material": MEASURED, "continuum__temperature": 0.05},
        "needs the bonds",
    ),
    (
        "continuum.temperature",
        {"continuum__material": crystal(), "continuum__temperature": 0},
        "needs the bonds",
    ),
    # how it is solved
    ("continuum.integrator", {"continuum__integrator": "usl"}, "does not fit the velocity"),
    ("continuum.integrator", {"continuum__integrator": "usf"}, "does not fit the velocity"),
    ("continuum.flip", {"continuum__flip": 1.01}, "must be a share"),
    ("continuum.damping[0].rate", {"continuum__damping": [{"rate": -1}]}, "must not be negative"),
    ("continuum.damping[0].flip", {"continuum__damping": [{"flip": -0.1}]}, "must be a share"),
    ("continuum.damping[0].box", {"continuum__damping": [{"box": [[0, 1], [1, 0]]}]}, "upper y"),
    # the force scheme
    *(
        (f"coupling.zones.{name}", FORCE | {f"coupling__zones__{name}": 8}, "velocity scheme;")
        for name in ("incommunicado", "inner", "filter")
    ),
    ("coupling.filter_rate", FORCE | {"coupling__filter_rate": 0}, "velocity scheme; the force"),
    (
        "continuum.interpolation",
        FORCE | {"continuum__interpolation": "cpgimp"},
        "fit the force scheme",
    ),
    ("continuum.integrator", FORCE | {"continuum__integrator": "usavg"}, "fit the force scheme"),
    (
        "coupling.zones.outer",
        FORCE | {"md__cutoff": 2.5, "coupling__zones__outer": 2.4},
        "narrower than the potential's cutoff",
    ),
    (  # two cutoffs and two cells of 4
        "md.region",
        FORCE | {"md__cutoff": 2.5, "md__region": [[0, 80], [20, 32.9]]},
        "is 12.9 wide along y; ghost atoms",
    ),
    ("md.region", FORCE | {"md__region": [[0, 80], [20, 72.1]]}, "within 7.9 of the domain's top"),
    ("coupling.planes.left", planes(left=4), "there is no interface"),
    ("coupling.planes.top", planes(top=None), "missing at an interface"),
    ("coupling.planes.top", planes(top=60), "lies outside md.region"),
    ("coupling.planes", planes(bottom=49), "free atoms less than 2 cells (8) along y"),
    (
        "coupling.planes.top",
        planes(top=69) | {"md__region": [[0, 80], [20, 72]]},
        "comes within 11 of the domain's top face",
    ),
    (  # region and 4 cells of 2 need [0, 88] x [12, 68]
        "grid.levels",
        FORCE | {"grid__levels": [{"boxes": [[[0, 80], [0, 80]]]}]},
        "its filter (0) and 4 cells (8) around",
    ),
    # loads
    ("continuum.body_force", {"continuum__body_force": {"acceleration": [0, 1]}}, "not feel it"),
    (
        "continuum.body_force.ramp",
        ALONE | {"continuum__body_force": {"acceleration": [0, 1], "ramp": -1}},
        "must not be negative",
    ),
    (
        "boundary.left.history",
        face(condition="traction", value=[1, 0], history=[[0, 0], [0, 1]]),
        "do not ascend",
    ),
    (
        "boundary.left.ramp",
        face(condition="traction", value=[1, 0], history=[[0, 1]], ramp=1),
        "beside a history",
    ),
    ("boundary.left", face(condition="displacement", value=[1, 0]), "must begin at zero"),
    (
        "boundary.left",
        face(condition="displacement", value=[1, 0], history=[[0, 0.1], [1, 1]]),
        "must begin at zero",
    ),
    ("boundary.left.value", face(condition="displacement", ramp=1), "needs a value"),
    ("boundary.left.value", face(condition="absorbing", value=[1, 0]), "takes no value"),
    (
        "boundary.left.condition",
        {"boundary__left": {"condition": "absorbing"}},
        "is not known to the atoms",
    ),
    (
        "boundary.right.condition",
        {
            "only": "md",
            "boundary__right": {"condition": "displacement", "value": [1, 0], "ramp": 1},
        },
        "is not known to the atoms",
    ),
    # start
    (
        "initial.velocities[0].box",
        ALONE | {"initial__velocities": [{"velocity": [0, 0], "box": [[1, 0], [0, 1]]}]},
        "upper x is not above",
    ),
    (
        "initial.velocities[0].center",
        ALONE | {"initial__velocities": [{"velocity": [0, 0], "center": [1, 0]}]},
        "without a gradient",
    ),
    # cracks
    ("continuum.cracks[0].along", cracked(along=[0, 1]), "three dimensions"),
    (
        "continuum.cracks[0].along",
        cracked(BLOCK, **{"from": [0, 20, 0], "to": [20, 20, 0]}),
        "missing in three dimensions",
    ),
    (
        "continuum.cracks[0].along",
        cracked(BLOCK, **{"from": [0, 20, 0], "to": [20, 20, 0], "along": [4, 0, 0]}),
        "is parallel",
    ),
    (
        "continuum.cracks[0]",
        cracked(BLOCK, **{"from": [0, 20, 0], "to": [20, 20, 0], "along": [0, 0, 25]}),
        "its end (20, 20, 25) leaves the domain",
    ),
    (
        "continuum.configuration",
        {"coupling__scheme": "paper", "md__region": [[0, 80], [16, 64]]}
        | {"continuum__configuration": "reference"},
        "does not fit the paper scheme",
    ),
    (
        "continuum.interpolation",
        {"continuum__interpolation": "cpgimp"},
        "no meaning in the reference configuration",
    ),
    ("continuum.xpic.every", {"continuum__xpic__every": 20}, "filters nothing but waves"),
    (
        "continuum.dispersion",
        {"continuum__dispersion": "corrected"},
        "is not corrected in the velocity scheme",
    ),
    (
        "continuum.configuration",
        FORCED | {"continuum__configuration": "current"},
        "does not fit the force scheme",
    ),
    (
        "continuum.interpolation",
        {"only": "continuum", "continuum__configuration": "reference"}
        | {"continuum__interpolation": "cpgimp"},
        "no meaning in the reference configuration",
    ),
    ("continuum.xpic.every", FIXED | {"continuum__xpic__every": 20}, "filters nothing but waves"),
    (
        "continuum.dispersion",
        ALONE | {"continuum__dispersion": "corrected"},
        "in the reference configuration alone",
    ),
    (
        "continuum.integrator",
        CORRECTED | {"continuum__integrator": "usavg"},
        "does not go together",
    ),
    (
        "continuum.interpolation",
        CORRECTED | {"continuum__interpolation": "bspline"},
        "has another dispersion",
    ),
    ("continuum.cracks", cracked() | {"domain__periodic": [True, False]}, "do not go together"),
    ("continuum.cracks[0].friction", cracked(friction=0.1), "without contact"),
    ("continuum.cracks[0].friction", cracked(contact="frictional", friction=-1), "negative"),
    (
        "continuum.cracks[1].contact",
        ALONE | {"continuum__cracks": [ENDS, ENDS | {"contact": "frictional"}]},
        "differs from the first crack's",
    ),
    ("continuum.cracks[0].j_radius", cracked(j_radius=7.9), "between 2 cells (8) and 40"),
    ("continuum.cracks[0].j_radius", cracked(j_radius=40.1), "between 2 cells (8) and 40"),
    (  # ends inside level 1
        "continuum.cracks[0]",
        cracked(levels([[[48, 80], [16, 64]]])),
        "comes within 3 cells of the rim of a level",
    ),
    (  # passes level 1's corner, 8 below and 10 to the side: 3 cells are 12
        "continuum.cracks[0]",
        cracked(levels([[[72, 100], [48, 64]]]), to=[62, 40]),
        "comes within 3 cells",
    ),
    (  # 3 cells of 2 are wanted behind the tip; there are 2.9
        "continuum.cracks[0]",
        cracked(levels([[[0, 64], [16, 64]]]), to=[58.2, 40]),
        "comes within 3 cells",
    ),
]

KEEPS: list[dict[str, Any]] = [
    {},
    {"grid__points_per_axis": 4},
    {"grid__points_per_axis": 1, "coupling__zones__inner": 16, "md__region": [[0, 80], [12, 68]]},
    {"md__ranks": 200},
    {"md__cutoff": 4.0},
    {"coupling__zones__inner": 8.0},
    {"coupling__zones__incommunicado": 0},
    {"coupling__scheme": "paper", "md__region": [[0, 80], [16, 64]]},
    {"coupling__scheme": "paper", "md__region": [[0, 80], [16, 64]]}
    | {"continuum__integrator": "usl"},
    {"coupling__filter_rate": 0},
    {"continuum__xpic__every": 0},
    {"continuum__configuration": "current", "continuum__dispersion": "lumped"},
    {"continuum__configuration": "current", "continuum__interpolation": "cpgimp"}
    | {"continuum__xpic__every": 20},
    {"continuum__configuration": "reference"},
    FIXED,
    FIXED | {"continuum__integrator": "usavg", "continuum__xpic__every": 0},
    CORRECTED,
    CORRECTED | {"continuum__interpolation": "linear", "continuum__integrator": "musl"},
    BLOCK | {"continuum__configuration": "reference", "continuum__dispersion": "corrected"},
    {"continuum__material": material(lame=-27.79)},
    bonded(),
    {"continuum__integrator": "musl"},
    {"only": "continuum", "continuum__integrator": "usavg"},
    {"only": "continuum", "continuum__cracks": crack(119)},
    {"only": "md", "md__region": [[0, 120], [0, 80]]},
    {"time__end": 0.002},
    {"md__region": [[0, 80], [21.9, 58.0]]},  # 36.1 wide; the zones take 36
    {"md__region": [[0, 80], [20, 72]]},  # 8 to the face, two cells
    {"domain__periodic": [False, True], "md__region": [[0, 80], [0, 80]]},
    {"boundary__left": {"condition": "velocity", "value": [None, 0]}},
    {"boundary__left": LEFT},
    {"md__ranks": 4, "md__patches": [4, 1]},
    {"continuum__cracks": crack(61.9)},  # depth 18.1
    {"initial__packets": packet(center=120)},
    {"name": "Mode-1_small.2"},
    {"time__md_steps": 211},
    {"time__md_steps": "auto"},
    {"continuum__material": MEASURED, "time__md_steps": "auto"},
    {"continuum__material": MEASURED | {"model": "cauchy-born"}, "continuum__temperature": 0.05},
    ALONE,
    BLOCK,
    ALONE | {"time": {"end": 8, "step": 0.42}},
    {"only": "continuum", "domain__box": [[0, 120], [0, 80], [0, 8]]}
    | {"md__region": [[0, 80], [20, 60], [0, 8]]},
    levels(*[[[[0, 120], [0, 80]]]] * 7),
    levels([[[16, 24], [16, 24]]]),
    levels([[[16, 40], [16, 40]], [[56, 80], [16, 40]]]),
    levels([[[16, 64], [16, 64]]], [[[24, 40], [24, 56]]]),
    levels([[[0, 64], [0, 64]]], [[[0, 40], [0, 40]]]),
    levels([[[16, 40], [0, 80]]]) | {"domain__periodic": [False, True]},
    levels([[[16, 40], [16, 40]]]) | {"domain__periodic": [False, True]},
    BLOCK | {"grid__levels": [{"boxes": [[[0, 24], [0, 40], [0, 24]]]}]},
    {"grid__levels": [{"boxes": [[[0, 92], [0, 80]]]}]},
    FORCE | {"md__cutoff": 4.1, "coupling__zones__outer": 4.1},
    FORCE | {"md__cutoff": 4.1},
    FORCE | {"md__cutoff": 2.5, "md__region": [[0, 80], [20, 33]]},
    FORCE | {"md__region": [[0, 80], [20, 72]]},
    FORCE | {"continuum__interpolation": "linear", "continuum__integrator": "musl"},
    FORCE | {"continuum__xpic__every": 0},
    FORCE | {"grid__levels": [{"boxes": [[[0, 88], [0, 80]]]}]},
    regions(*PAIR),
    regions(*PAIR) | {"continuum__cracks": [{"from": [10, 38], "to": [20, 38]}]},
    regions(*PAIR) | {"boundary__top": {"condition": "absorbing"}},
    FORCE | {"md__cutoff": 2.5} | regions(*PAIR),
    FORCE | regions(*PAIR) | {"only": "md"},
    planes(),
    planes(bottom=48),
    planes(top=68) | {"md__region": [[0, 80], [20, 72]]},
    FORCE | {"only": "continuum", "coupling__filter_rate": 1, "continuum__interpolation": "cpgimp"},
    {"grid__levels": [{"boxes": [[[0, 104], [0, 80]]]}], "coupling__zones__filter": 16},
    ALONE | {"continuum__ranks": 600},
    ALONE | {"continuum__ranks": 4, "continuum__patches": [4, 1]},
    BLOCK | {"continuum__ranks": 6, "continuum__patches": [1, 1, 6]},
    {"continuum__ranks": 2},
    BLOCK | {"continuum__material": material(lame=-18.5)},
    {"continuum__material": material(plane="stress")},
    {"continuum__material": material(model="neo-hookean")},
    {"continuum__material": crystal()},
    anisotropic(STIFF),
    ALONE | anisotropic(STIFF) | {"initial__packets": packet()},
    ALONE | {"initial__packets": packet(tilt=-41.7)},
    ALONE | {"domain__periodic": [False, True], "initial__packets": packet(tilt=30)},
    ALONE | anisotropic(SLANTED),
    *(ALONE | {"continuum__integrator": name} for name in ("usf", "usl", "musl", "usavg")),
    *(ALONE | {"continuum__interpolation": name} for name in ("linear", "bspline", "cpgimp")),
    {"continuum__flip": 0.0, "continuum__damping": [{"rate": 0, "flip": 1}]},
    {"only": "continuum", "continuum__body_force": {"acceleration": [0, 1], "ramp": 1}},
    face(condition="displacement", value=[1, None], ramp=1),
    face(condition="displacement", value=[1, None], history=[[0, 0], [1, 1], [2, 0]]),
    face(condition="absorbing"),
    {"boundary__right": {"condition": "absorbing"}},
    BLOCK | {"boundary__front": {"condition": "traction", "value": [0, 0, 1]}},
    BLOCK | {"initial__packets": packet(axis=2, center=24, polarization="S")},
    ALONE
    | {
        "initial__velocities": [
            {"velocity": [0, 0], "gradient": [[0, 1], [0, 0]], "center": [1, 2]}
        ]
    },
    cracked(contact="frictional", friction=0.3, j_radius=8),
    cracked(j_radius=40),
    cracked(BLOCK, **{"from": [0, 20, 0], "to": [20, 20, 0], "along": [0, 0, 24]}),
    cracked(levels([[[0, 68], [16, 64]]])),
    cracked(levels([[[72.0, 100], [52.0, 64]]]), to=[60, 40 - 1e-3]),
    cracked(levels([[[0, 64], [16, 64]]]), to=[58, 40]),
]


def test_the_sound_case_is_sound(make: Make) -> None:
    assert check_case(make()) == []


@pytest.mark.parametrize(("key", "changes", "said"), BREAKS)
def test_broken_rules(make: Make, key: str, changes: dict[str, Any], said: str) -> None:
    found = check_case(make(**changes))
    matching = [p for p in found if p.key == key and said in p.message]
    assert matching, [str(p) for p in found]
    # a way out: a hint, or a message that says what must be
    assert all(p.hint or "must" in p.message for p in found), [str(p) for p in found]


@pytest.mark.parametrize("changes", KEEPS)
def test_rules_kept_at_their_limit(make: Make, changes: dict[str, Any]) -> None:
    assert [str(p) for p in check_case(make(**changes))] == []


def test_all_problems_are_found_at_once(make: Make) -> None:
    found = check_case(make(md__cutoff=99.0, boundary__left={"value": [1, 0]}, md__patches=[2, 2]))
    assert {p.key for p in found} == {"coupling.zones.outer", "boundary.left.value", "md.patches"}


def test_cfl_hint_is_stable(make: Make) -> None:
    """The hint's number of steps is accepted; one more is not."""
    (problem,) = check_stability(make(time__md_steps=1000))
    most = int(problem.hint.split()[2])
    assert check_stability(make(time__md_steps=most)) == []
    assert check_stability(make(time__md_steps=most + 1)) != []
    (problem,) = check_stability(make(time__md_timestep=10.0, time__md_steps=1))
    assert "enlarge grid.cell" in problem.hint


def test_md_time_step_against_the_lattice(make: Make) -> None:
    limit = 0.5 / (2.31 * make().wave_speed("P") / 1.1132)
    assert check_stability(make(time__md_timestep=limit * 0.99, time__md_steps=1), 1.1132) == []
    (problem,) = check_stability(make(time__md_timestep=limit * 1.01, time__md_steps=1), 1.1132)
    assert problem.key == "time.md_timestep"
    alone = make(time__md_timestep=limit * 1.01, time__md_steps=1, only="continuum")
    assert check_stability(alone, 1.1132) == []


def test_files_beside_the_case(make: Make, tmp_path: Path) -> None:
    case = make(md__after="after.in", md__files=["table.txt"], continuum__material=MEASURED)
    missing = check_case(case, tmp_path)
    keys = {"md.input", "md.after", "md.files[0]", "continuum.material.cell"}
    assert {p.key for p in missing} == keys
    assert all(str(tmp_path) in p.hint for p in missing)
    for name in ("md.in", "after.in", "table.txt", "cell.in"):
        (tmp_path / name).write_text("")
    assert check_case(case, tmp_path) == []
    (tmp_path / "md.in").unlink()
    (tmp_path / "md.in").mkdir()
    assert [p.key for p in check_case(case, tmp_path)] == ["md.input"]


wild = st.one_of(st.floats(), st.sampled_from([0.0, 1e-300, 1e300, -1.0, 1e99, 1e-99]))
wild_pair = st.tuples(wild, wild).map(list)
wild_box = st.tuples(wild_pair, wild_pair).map(list)


@given(
    st.fixed_dictionaries(
        {},
        optional={
            "domain__box": wild_box,
            "md__region": wild_box,
            "grid__cell": wild,
            "grid__points_per_axis": st.integers(-(2**63), 2**63 - 1),
            "time__end": wild,
            "time__md_timestep": wild,
            "time__md_steps": st.integers(-(2**63), 2**63 - 1) | st.just("auto"),
            "md__ranks": st.integers(-(2**63), 2**63 - 1),
            "md__patches": st.tuples(*[st.integers(-(2**63), 2**63 - 1)] * 2).map(list),
            "continuum__material": st.fixed_dictionaries(
                {"from": st.just("moduli"), "density": wild, "lame": wild, "shear": wild}
            ),
            "coupling__zones__outer": wild,
            "coupling__zones__inner": wild,
            "coupling__filter_rate": wild,
            "output__interval": wild,
            "only": st.sampled_from(["md", "continuum", None]),
            "domain__periodic": st.tuples(st.booleans(), st.booleans()).map(list),
            "continuum__cracks": st.lists(
                st.fixed_dictionaries({"from": wild_pair, "to": wild_pair}), max_size=2
            ),
        },
    )
)
def test_senseless_numbers_are_judged_not_stumbled_over(
    make: Make, changes: dict[str, Any]
) -> None:
    case = make(**changes)
    if not check_case(case):
        assert case.steps() >= 1
        assert case.output_every() >= 1
        if case.md.patches == "auto":
            px, py = case.md_patches()
            assert px * py == case.md.ranks
        case.zones()
        case.background_grid()


def test_the_scheme_as_published_is_cautioned_of(make: Make) -> None:
    assert cautions(make()) == []
    (said,) = cautions(make(coupling__scheme="paper"))
    assert "unstable without damping" in said
    assert cautions(make(coupling__scheme="paper", only="md")) == []


def test_the_scheme_as_published_has_four_layers_to_buffer_and_inner_zone(make: Make) -> None:
    zones = make(coupling__scheme="paper").zones()
    assert (zones.incommunicado, zones.inner) == (8.0, 8.0)
    assert make(coupling__scheme="paper").filter_rate() == 0.0
