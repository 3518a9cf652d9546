"""``mpiexec`` with a list of hosts, and the template of a PBS job: same bits as on one host.

In place of ssh, ``mpiexec`` enters the network of a host by a script. There is no PBS here: the
test sets what PBS sets, and runs the template on the first host.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from gimpmd_deploy.results.run import Run
from tests.cluster.conftest import Cluster
from tests.conftest import ROOT
from tests.small_run import ENVIRONMENT, GIMPMD, check_same_bits, write

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(600)]

NETWORKS = {"10.77.0.2": "gimpmd-h2", "10.77.0.3": "gimpmd-h3"}

ENTER = """\
#!/bin/bash
# called as ssh is: [-x] HOST COMMAND...
[ "$1" = -x ] && shift
host=$1
shift
echo "$host" >>{log}
case $host in
{cases}
esac
exec nsenter --net=/run/netns/$network /bin/sh -c "$*"
"""


@pytest.fixture
def launcher(tmp_path: Path) -> dict[str, str]:
    """Settings with which ``mpiexec`` starts its processes on the hosts of the cluster."""
    script = tmp_path / "enter"
    cases = "\n".join(f"{host}) network={name};;" for host, name in NETWORKS.items())
    script.write_text(ENTER.format(log=tmp_path / "hosts.log", cases=cases))
    script.chmod(0o755)
    return {"HYDRA_LAUNCHER": "ssh", "HYDRA_LAUNCHER_EXEC": str(script)}


def test_the_template_for_pbs_gives_the_bits_of_one_host(
    cluster: Cluster, tmp_path: Path, local: Run, launcher: dict[str, str]
) -> None:
    out, hosts = tmp_path / "run", tmp_path / "hosts"
    words = [GIMPMD, "prepare", str(write(tmp_path, 2.0)), "--out", str(out)]
    subprocess.run(words, check=True, capture_output=True)
    hosts.write_text("".join(f"{host}\n" for host in NETWORKS))
    job = {
        "RUN": str(out),
        "RANKS_MD": "2",
        "RANKS_GIMP": "1",
        "PBS_NODEFILE": str(hosts),
        "PBS_JOBID": "4711.server",
    }
    done = subprocess.run(
        ["nsenter", "--net=/run/netns/gimpmd-h2", "bash", str(ROOT / "deploy" / "job.pbs")],
        env=ENVIRONMENT | launcher | job,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=400.0,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    check_same_bits(Run(out), local)
    # the second rank of the MD; the first host is where mpiexec runs
    assert (tmp_path / "hosts.log").read_text() == f"{list(NETWORKS)[1]}\n"
