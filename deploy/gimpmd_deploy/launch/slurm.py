"""Batch scripts for Slurm: one allocation, in which each side is a step of its own.

A job that reaches its time limit, or loses a host, goes on from its last checkpoint when Slurm
starts it again.
"""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Sequence
from pathlib import Path

from gimpmd_deploy.launch.by_hand import commands
from gimpmd_deploy.launch.processes import ENVIRONMENT
from gimpmd_deploy.launch.services import NAMES
from gimpmd_schemas.case.plan import Plan
from gimpmd_schemas.errors import STOPPED, BackendError

ENDPOINT = "tls/$host:$port"
"""Where the coupler listens; the script finds out on which node it runs."""

PATIENCE = 60
"""Seconds after the end of the coupler, or of one rank of a side, within which the others must end.

A rank may end before MPI has started on the others, which would then wait for ever.
"""

SCRIPT = """\
#!/bin/bash
#SBATCH --job-name={name}
#SBATCH --ntasks={tasks}
#SBATCH --time={time}
#SBATCH --signal=B:USR1@{notice}
#SBATCH --output={folder}/logs/slurm-%j.log
#SBATCH --open-mode=append
#SBATCH --requeue
{options}
# The coupler runs on the first node, as this script does; the ranks connect to it with TLS.
set -eu
export {environment}
address=$(scontrol show node --oneliner "$SLURMD_NODENAME" | grep -o 'NodeAddr=[^ ]*')
host=${{address#NodeAddr=}}
port=$((20000 + SLURM_JOB_ID % 20000))
keys={folder}/keys/$SLURM_JOB_ID-${{SLURM_RESTART_COUNT:-0}}
{gimpmd} keys new "$keys" --host "$host" {ranks}

{coupler} --keys "$keys" &
coupler=$!
# A stop ends the run with a checkpoint. Slurm sends USR1 before the time limit: the job then goes
# on in another allocation. So it does after a host has failed, from the last checkpoint.
stop() {{
  kill -TERM $coupler 2>/dev/null || true
}}
trap stop TERM
again=
trap 'again=yes; stop' USR1
start() {{
  "$@" &
  trap "kill -KILL $!" USR2
  wait $! || {{  # without this side the run cannot go on, whether or not its ranks have registered
    failed=$?
    stop
    return $failed
  }}
}}
# a side may use any of the nodes, and need not use all
nodes=1-$SLURM_JOB_NUM_NODES
sides=
{sides}
code=0
while kill -0 $coupler 2>/dev/null; do
  code=0
  wait $coupler || code=$?
done
# srun waits for ever for ranks of whose end it was not told, because the network was cut
(sleep {patience} && kill -USR2 $sides 2>/dev/null) &
late=$!
for side in $sides; do
  wait $side || {{
    failed=$?
    case $code in 0 | {stopped}) code=$failed ;; esac
  }}
done
kill $late 2>/dev/null || true
[ -z "$again" ] || [ $code -ne {stopped} ] || scontrol requeue "$SLURM_JOB_ID"
exit $code
"""


def script(
    plan: Plan,
    folder: Path,
    run: str,
    time: str,
    notice: int,
    options: Sequence[str],
    programs: Path,
) -> str:
    """Return the batch script of a run.

    Parameters
    ----------
    plan : Plan
    folder : Path
        The run folder, which all nodes can reach.
    run : str
        The run id.
    time : str
        Time limit, as Slurm writes it.
    notice : int
        Seconds before the limit at which the run is asked to end.
    options : sequence of str
        Further options of ``sbatch`` without dashes, such as ``partition=gpu``.
    programs : Path
        Folder of the commands of gimpmd on the nodes.
    """
    words = commands(plan, folder, run, ENDPOINT)
    sides = []
    for role in plan.roles:
        text = _line(words[NAMES[role]], programs)
        place = f'--ntasks={plan.ranks(role)} --nodes="$nodes" --exact --immediate=60'
        srun = f"srun {place} --wait={PATIENCE} --mpi=pmi2"
        sides.append(f'start {srun} \\\n  {text} --keys "$keys" &\nsides="$sides $!"')
    return SCRIPT.format(
        name=plan.name,
        tasks=1 + sum(plan.ranks(role) for role in plan.roles),
        time=time,
        notice=notice,
        stopped=STOPPED,
        patience=PATIENCE,
        folder=shlex.quote(str(folder.absolute())),
        options="".join(f"#SBATCH --{option}\n" for option in options),
        environment=" ".join(f"{name}={value}" for name, value in ENVIRONMENT.items()),
        ranks=" ".join(f"--ranks-{NAMES[role]} {plan.ranks(role)}" for role in plan.roles),
        gimpmd=shlex.quote(str(programs / "gimpmd")),
        coupler=_line(words["coupler"], programs),
        sides="\n".join(sides),
    )


def _line(words: Sequence[str], programs: Path) -> str:
    """Words as shell text; the endpoint stays open for the shell to fill in."""
    first, *rest = words
    quoted = [f'"{word}"' if word == ENDPOINT else shlex.quote(word) for word in rest]
    return " ".join([shlex.quote(str(programs / first)), *quoted])


def submit(path: Path) -> str:
    """Submit a batch script; return the id of the job.

    Raises
    ------
    BackendError
        There is no ``sbatch``, or it refuses the job.
    """
    try:
        done = subprocess.run(
            ["sbatch", "--parsable", str(path)], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        hint = "submit it on a host of the cluster"
        raise BackendError(f"there is no sbatch on this host; {path} is written: {hint}") from None
    if done.returncode != 0:
        raise BackendError(f"sbatch refuses {path}: {done.stderr.strip()}")
    return done.stdout.strip().split(";")[0]
