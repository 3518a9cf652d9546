"""Conditions on the rim: which parts of faces, their force, and the stiffness of driven bodies."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gimpmd_md.loads import RimPart
from gimpmd_md.loads import rim_parts as parts_of_plan
from gimpmd_md.side import MdSide
from gimpmd_schemas.case.conditions import Face
from gimpmd_schemas.case.face_parts import FacePart
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import make_plan
from gimpmd_schemas.mechanics.units import UNITS
from tests.services.md.block import ALONE, ROW

Make = Callable[..., Case]
Start = Callable[[Case], MdSide]
TOP = {"condition": "traction", "value": [None, 0.2], "ramp": 1.0}


def rim_parts(case: Case, conditions: tuple[str, ...]) -> list[RimPart]:
    return parts_of_plan(make_plan(case), conditions)


def keys(case: Case, *conditions: str) -> list[str]:
    return [rim.part.key for rim in rim_parts(case, conditions)]


def test_only_faces_on_the_rim_of_the_domain_count(make: Make) -> None:
    loads = {"top": TOP, "bottom": TOP, "left": {"condition": "symmetry"}}
    assert keys(make(boundary=loads), "traction", "symmetry") == []
    above = make(boundary=loads, md__region=[[13, 39], [26, 52]])
    assert keys(above, "traction") == ["boundary.top"]
    alone = make(boundary=loads, only="md")
    assert keys(alone, "traction") == ["boundary.bottom", "boundary.top"]
    assert keys(alone, "symmetry") == ["boundary.left"]


def test_regions_share_a_face_by_their_lengths(make: Make) -> None:
    """Of three regions two end on the top of the domain, and its load ends at x = 42."""
    boxes = [[[0, 13], [40, 52]], [[39, 45], [30, 52]], [[13, 30], [6, 12]]]
    top = [TOP | {"extent": [[0, 42]]}]
    case = make(boundary={"top": top, "left": TOP}, md__region=None, md__regions=boxes)
    left, part = rim_parts(case, ("traction",))
    assert (left.part.key, left.size) == ("boundary.left", 12.0)
    assert (part.part.key, part.size) == ("boundary.top[0]", 16.0)
    assert left.bit != part.bit


def test_layer_is_within_a_depth_of_the_outermost_atoms_of_all_ranks() -> None:
    x = np.array([[0.0, 0.0], [1.0, 5.0], [2.0, 9.5], [1.5, 9.8]])
    low, high = np.array([-1.0, 0.0]), np.array([2.0, 10.0])

    def rim(axis: int, side: int, face: Face) -> RimPart:
        part = FacePart(axis, side, "", face, ((-1.0, 2.0), (0.0, 10.0)), np.eye(3))
        return RimPart(part, 8, 1.0)

    top, left = rim(1, 1, Face()), rim(0, 0, Face())
    assert top.layer(low, high, x, 1.0).tolist() == [False, False, True, True]
    assert left.layer(low, high, x, 1.5).tolist() == [True, False, False, False]
    right_half = rim(1, 1, Face(extent=((1.6, 2.0),)))
    assert right_half.layer(low, high, x, 1.0).tolist() == [False, False, True, False]


def test_force_is_traction_times_length_in_the_style_s_units(make: Make, start: Start) -> None:
    """Half of the top carries a traction that grows linearly from 0.1 to 0.3: 0.2 on average."""
    value = {"profile": "linear", "value": [None, 0.2], "center": [6.5, 26]}
    value["gradient"] = [[0, 0], [0.2 / 13, 0]]
    top = [{"condition": "traction", "value": value, "extent": [[0, 13]]}]
    side = start(make(**ALONE, boundary={"top": top}))
    side._loads.apply(0.0, 0.1)
    external, site = side.atoms.external, side.atoms.site
    assert external[:, 1].sum() == pytest.approx(0.2 * 13.0 / UNITS["lj"].nktv2p, rel=0.03)
    loaded = external[:, 1] != 0.0
    assert site[loaded, 0].max() < 13.0
    share = external[loaded, 1] / (0.2 + 0.2 / 13 * (site[loaded, 0] - 6.5))
    np.testing.assert_allclose(share, share.mean(), rtol=1e-9)


def test_a_driven_strip_is_as_stiff_as_the_continuum(start: Start, make: Make) -> None:
    """Its length, by the force that stretches it and C11, is that of the domain; periodic along y.

    The atoms lie up to half a spacing inside the faces. Layers as deep as the cutoff that move
    rigidly make the body 4.7 shorter, rigid zigzag layers 1.3 (pure LAMMPS).
    """
    width = 24 * ROW
    length, strain = 2 * width, 2e-4
    move = {"condition": "displacement", "value": [strain * length, None], "ramp": 40.0}
    case = make(
        only="md",
        domain={"box": [[0, length], [0, width]], "periodic": [False, True]},
        grid__cell=width / 8,
        md__region=[[0, length], [0, width]],
        md__variables={"edge": "p"},
        boundary={"left": {"condition": "symmetry"}, "right": move},
    )
    side = start(case)
    loads, atoms = side._loads, side.atoms
    rim = next(r for r in loads._driven if r.part.key == "boundary.right")
    forces = []
    for _ in range(1500):  # to t = 60
        side.receive({})
        side.advance()
        side.finish()
        time = side._step * side._plan.step
        if time > 40.0:
            rows = loads._having(rim.bit)
            pull = loads._pull(rim, atoms.site[rows], time)
            pull -= loads._stiffness[rim.bit] * (atoms.x - atoms.rest)[rows]
            forces.append(pull[:, 0].sum())
    stress = np.mean(forces) / width
    assert strain * length * side._plan.stiffness()[0, 0] / stress == pytest.approx(length, abs=0.2)
