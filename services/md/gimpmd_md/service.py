"""The commands of the MD service.

``gimpmd-md serve`` takes part in a run. It is an MPI program with one rank per patch. Between
coupling steps its ranks sleep on the bus, not in a collective call. ``gimpmd-md probe`` makes the
atoms of a case and describes them. ``gimpmd-md cell`` tells how the periodic cell of a material
repeats, and ``gimpmd-md surfaces`` the energies of its surfaces. ``gimpmd-md stiffness`` measures
the stiffness of the atoms of the sites scheme. Two commands need no case:
``gimpmd-md lattice`` measures a crystal at zero pressure, and ``gimpmd-md strain``, an MPI program
too, computes the strain of the atoms of a dump.
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import msgspec

from gimpmd_coupler.arguments import add_arguments, keys_of
from gimpmd_coupler.exit import exit_together
from gimpmd_coupler.loop import run_service
from gimpmd_coupler.participant import Participant
from gimpmd_md.coupling.halo import own_patch
from gimpmd_md.side import open_side
from gimpmd_schemas.case.form import Case
from gimpmd_schemas.case.load import load_case
from gimpmd_schemas.case.plan import load_plan
from gimpmd_schemas.checkpoint.states import saved_states
from gimpmd_schemas.errors import GimpmdError
from gimpmd_schemas.on_disk import folder_of_logs
from gimpmd_schemas.registry import load_code

log = logging.getLogger(__name__)


def serve(options: argparse.Namespace) -> int:
    """Take part in a run as one rank of an MPI program; returns the exit code."""
    from mpi4py import MPI

    run_dir = options.run_dir.resolve()
    exit_comm = MPI.COMM_WORLD.Dup()  # only failed ranks communicate here
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _end)
    try:
        _log_to(folder_of_logs(run_dir) / "md.log", MPI.COMM_WORLD.rank)
        _run_in(run_dir, options, MPI.COMM_WORLD)
    except (Exception, SystemExit) as error:
        if isinstance(error, (GimpmdError, SystemExit)):
            log.error("%s", error)
        else:
            log.exception("the MD service failed")
        return exit_together(exit_comm, error, "gimpmd-md")
    return 0


def _run_in(run_dir: Path, options: argparse.Namespace, comm: Any) -> None:
    plan, keys = load_plan(run_dir / "plan.yaml"), keys_of(options)
    os.chdir(run_dir / "input")
    with Participant(
        endpoint=options.connect,
        run=options.run,
        plan=plan,
        role="md",
        rank=comm.rank,
        ranks=comm.size,
        backend=load_code("md", plan.atoms.backend).version(),
        patch=own_patch(plan.atoms.region, plan.atoms.patches, comm),
        keys=keys,
        patience=options.patience,
    ) as participant:
        participant.heed_sigterm()
        saved = saved_states(run_dir, "md", comm.rank, plan)
        side = open_side(plan, comm, Path(".."), saved)
        log.info("this rank offers %d nodes and needs %d", side.offers.size, side.needs.size)
        run_service(side, plan, participant, run_dir, saved)
        side.close()


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(f"ended by {signal.Signals(number).name}")


def _log_to(path: Path, rank: int) -> None:
    logging.basicConfig(
        filename=path,
        level=logging.INFO if rank == 0 else logging.WARNING,
        format=f"%(asctime)s md/{rank} %(levelname)s %(message)s",
    )


def print_answer(ask: Callable[[Any], msgspec.Struct]) -> int:
    """Print an answer as one JSON object on standard output; returns the exit code.

    Parameters
    ----------
    ask : callable
        Takes a communicator of this process alone, and returns the answer.
    """
    from mpi4py import MPI

    try:
        print(msgspec.json.encode(ask(MPI.COMM_SELF)).decode())
    except GimpmdError as error:
        print(f"gimpmd-md: {error}", file=sys.stderr)
        return error.exit_code
    return 0


def _case_at(path: Path) -> Case:
    """Read a case, and make its folder the current one: scripts are named relative to it."""
    case = load_case(path)
    os.chdir(path.resolve().parent)
    return case


def show_probe(path: Path, only: str | None) -> int:
    """Describe the atoms of a case; see `print_answer`."""
    from gimpmd_md.probe import probe

    def ask(comm: Any) -> msgspec.Struct:
        case = _case_at(path)
        return probe(case if only is None else msgspec.structs.replace(case, only=only), comm)

    return print_answer(ask)


def show_cell(path: Path) -> int:
    """Print how the cell of a material repeats; see `print_answer`."""
    from gimpmd_md.crystal.repeat import repeat_of

    return print_answer(lambda comm: repeat_of(_case_at(path), comm))


def show_surfaces(path: Path) -> int:
    """Print the surface energies of a material; see `print_answer`."""
    from gimpmd_md.crystal.surface import surfaces_of

    return print_answer(lambda comm: surfaces_of(_case_at(path), comm))


def write_stiffness(path: Path, out: Path) -> int:
    """Measure the stiffness of the atoms of a case, and write it; see `print_answer`."""
    from gimpmd_md.stiffness import measure

    out = out.resolve()

    def ask(comm: Any) -> msgspec.Struct:
        with tempfile.TemporaryDirectory() as folder:
            return measure(_case_at(path), comm, Path(folder), out)

    return print_answer(ask)


def show_lattice(text: str) -> int:
    """Print a crystal at zero pressure; see `print_answer`."""
    from gimpmd_md.crystal.lattice import answer
    from gimpmd_schemas.wire.lattice import Question

    return print_answer(lambda comm: answer(msgspec.json.decode(text, type=Question), comm))


def strain_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``gimpmd-md strain``."""
    parser.add_argument("dump", type=Path, help="text dump of LAMMPS")
    parser.add_argument("--out", type=Path, required=True, help="the dump with strains")
    parser.add_argument("--reference", default="first", help="first, a step, or another dump")
    parser.add_argument("--dimension", type=int, choices=(2, 3), help="by the extent in z")
    for name in ("method", "weights", "measure"):
        parser.add_argument(f"--{name}", default=argparse.SUPPRESS)
    for name in ("cell", "spacing", "cutoff"):
        parser.add_argument(f"--{name}", type=float, default=argparse.SUPPRESS)


def show_strain(options: argparse.Namespace) -> int:
    """Compute the strains of a dump; print a summary as one JSON object; returns the exit code."""
    from mpi4py import MPI

    from gimpmd_strain.offline import strain_of_dump
    from gimpmd_strain.settings import Settings

    comm = MPI.COMM_WORLD
    given = {
        name: getattr(options, name) for name in Settings.__annotations__ if hasattr(options, name)
    }
    try:
        summary = strain_of_dump(
            options.dump, options.out, Settings(**given), comm, options.reference, options.dimension
        )
    except GimpmdError as error:
        if comm.rank == 0:
            print(f"gimpmd-md: {error}", file=sys.stderr)
        return error.exit_code
    except Exception:
        if comm.size == 1:
            raise
        log.exception("rank %d failed", comm.rank)
        comm.Abort(3)  # else the other ranks would wait for ever
        raise
    if comm.rank == 0:
        print(msgspec.json.encode(summary).decode())
    return 0


def main() -> int:
    """Entry point of ``gimpmd-md``: 0; 2 bad input; 3 a lost or failed service."""
    parser = argparse.ArgumentParser(prog="gimpmd-md", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    serving = commands.add_parser("serve", help="take part in a run (an MPI program)")
    add_arguments(serving)
    probing = commands.add_parser("probe", help="make the atoms of a case and describe them")
    probing.add_argument("--case", type=Path, required=True, help="the case file")
    probing.add_argument("--only", choices=("md", "continuum"), help="as in a run of one side")
    repeating = commands.add_parser("cell", help="how the material's periodic cell repeats")
    repeating.add_argument("--case", type=Path, required=True, help="the case file")
    cutting = commands.add_parser("surfaces", help="surface energies of the material")
    cutting.add_argument("--case", type=Path, required=True, help="the case file")
    pushing = commands.add_parser("stiffness", help="stiffness of the atoms, for the continuum")
    pushing.add_argument("--case", type=Path, required=True, help="the case file")
    pushing.add_argument("--out", type=Path, required=True, help="an .npz file")
    resting = commands.add_parser("lattice", help="a crystal at zero pressure")
    resting.add_argument("--question", required=True, help="JSON; see gimpmd_schemas.wire.lattice")
    strain_options(commands.add_parser("strain", help="strain of a dump (an MPI program)"))
    options = parser.parse_args()
    if options.command == "probe":
        return show_probe(options.case, options.only)
    if options.command == "cell":
        return show_cell(options.case)
    if options.command == "surfaces":
        return show_surfaces(options.case)
    if options.command == "stiffness":
        return write_stiffness(options.case, options.out)
    if options.command == "lattice":
        return show_lattice(options.question)
    if options.command == "strain":
        return show_strain(options)
    return serve(options)


if __name__ == "__main__":
    sys.exit(main())
