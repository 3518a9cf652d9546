"""The check of a service: our services pass it, and broken ones fail it, each for its reason."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from gimpmd_schemas.wire.conformance import Checked
from tests.services.coupler.check.broken import FAULTS, OPTIONS

BROKEN = Path(__file__).with_name("broken.py")
SECONDS = 250.0
pytestmark = pytest.mark.timeout(2 * SECONDS)


def check(*words: str) -> tuple[int, list[Checked]]:
    """Run the command; returns its exit code and the results."""
    gimpmd = [sys.executable, "-m", "gimpmd_deploy.cli.app", "check", "service", "--json"]
    done = subprocess.run(
        [*gimpmd, *words], capture_output=True, text=True, timeout=SECONDS, check=False
    )
    print(done.stdout, done.stderr)
    return done.returncode, [
        msgspec.json.decode(line, type=Checked) for line in done.stdout.splitlines()
    ]


@pytest.mark.parametrize(
    "side",
    [
        pytest.param(("continuum", "--backend", "fem"), id="continuum", marks=pytest.mark.long),
        pytest.param(("md",), id="md"),
    ],
)
def test_our_services_keep_step_and_the_balances(side: tuple[str, ...]) -> None:
    code, results = check("--side", *side, "--groups", "course")
    assert code == 0
    assert len(results) == (13 if side[0] == "continuum" else 12)
    assert all(result.passed for result in results)


@pytest.mark.long
@pytest.mark.parametrize("side", ["continuum", "md"])
@pytest.mark.parametrize(
    "options",
    [
        ("--ranks", "2", "--peers", "2"),
        ("--body", "levels"),
        ("--body", "space"),
        ("--body", "space", "--ranks", "2", "--peers", "2"),
    ],
    ids=["ranks", "levels", "space", "ranks in space"],
)
def test_our_services_pass_on_ranks_on_levels_and_in_space(
    side: str, options: tuple[str, ...]
) -> None:
    groups = "registration,course,checkpoint,translation,uniform strain,rotation"
    code, results = check("--side", side, *options, "--groups", groups, "--deadline", "30")
    assert code == 0
    assert len(results) > 25
    assert all(result.passed for result in results)


@pytest.mark.long
def test_a_code_without_levels_refuses_them() -> None:
    code, results = check("--side", "continuum", "--backend", "fem", "--body", "levels")
    assert code == 0
    assert all(result.passed is None for result in results)
    assert "refuses the plan: grid.levels: continuum.backend: fem has none" in results[0].came


@pytest.mark.long
@pytest.mark.parametrize(
    ("side", "backend"), [("continuum", "gimp"), ("continuum", "fem"), ("md", "lammps")]
)
def test_our_services_pass_all_checks(side: str, backend: str) -> None:
    code, results = check("--side", side, "--backend", backend)
    assert code == 0
    assert len(results) > 40
    assert all(result.passed for result in results)


STATES = "sends the payload of the first step"
REASONS: dict[str, tuple[str, str, str]] = {
    "wrong_version": ("registration", "speaks version 4 of the protocol", "protocol 3"),
    "wrong_plan": ("registration", "names the run, the plan and its rank", "plan = 000"),
    "too_few_nodes": (
        "registration",
        "offers the nodes that the other side needs, and needs no others",
        "offers without 1",
    ),
    "never_registers": ("registration", "registers with the coupler", "nothing of the kind"),
    "no_reports": (
        "course",
        "goes on when it may, and reports each step",
        "nothing of the kind",
    ),
    "wrong_step": ("course", STATES, "that of step 1"),
    "wrong_shape": ("course", STATES, "of shape"),
    "not_finite": ("course", STATES, "not finite"),
    "beyond_its_grant": ("course", "waits for a grant", "this payload"),
    "ignores_stop": (
        "course",
        "stays where it is when grants are taken back",
        "nothing of the kind",
    ),
    "loses_momentum": ("course", "changes its momentum by the impulse of the other side", "("),
    "hides_work": ("course", "reports the work of the other side", "0"),
    "ignores_requests_for_payloads": (
        "disturbances",
        "sends a payload again when it is asked to",
        "nothing of the kind",
    ),
    "asks_for_no_payload": (
        "disturbances",
        "asks again for a payload that was lost",
        "nothing of the kind",
    ),
    "counts_doubled_payloads": ("disturbances", "sends what it sends without faults", "off"),
    "believes_anybody": (
        "disturbances",
        "leaves frames alone that are no payload of the other side",
        "this payload",
    ),
    "ignores_failures": (
        "silence",
        "ends when another rank has failed, and names it",
        "nothing of the kind",
    ),
    "believes_any_field": (
        "wrong fields",
        "names the rank that sends a field that is not finite",
        "",
    ),
    "survives_the_coupler": (
        "lost coupler",
        "ends when the coupler is gone, and says so",
        "a service that runs",
    ),
    "wrong_digest": ("checkpoint", "reports the digest of the file", ""),
    "starts_anew": ("checkpoint", "registers at the step of the checkpoint", "first_step = 0"),
    "cracks_at_the_interface": ("uniform strain", "rests under a uniform strain", ""),
    "ignores_its_second_rank": (
        "course",
        "changes its momentum by the impulse of the other side",
        "(",
    ),
    "names_its_first_rank_twice": ("course", "has the mass of the body up to the planes", ""),
    "takes_rows_in_its_own_order": ("uniform strain", "rests under a uniform strain", ""),
    "mixes_up_y_and_z": ("course", "changes its momentum by the impulse of the other side", "("),
    "counts_nodes_along_y_first": (
        "registration",
        "offers the nodes that the other side needs, and needs no others",
        "the nodes",
    ),
    "forgets_the_coarse_level": ("course", "has the mass of the body up to the planes", ""),
    "holds_the_coarse_level": ("translation", "translates without strain", "of it"),
}
"""For each fault the group, the check that fails, and what came."""


def test_each_fault_has_a_reason() -> None:
    assert set(REASONS) == set(FAULTS)
    assert len(FAULTS) >= 10


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_broken_services_fail_for_their_reason(fault: str) -> None:
    group, what, came = REASONS[fault]
    groups = f"course,{group}" if group == "disturbances" else group
    options = OPTIONS.get(fault, ["--backend", "fem", "--deadline", "4"])
    command = ["--", sys.executable, str(BROKEN), fault]
    code, results = check("--side", "continuum", *options, "--groups", groups, *command)
    assert code == 3
    (failed,) = [result for result in results if result.passed is False]
    assert (failed.group, failed.what) == (group, what)
    assert came in failed.came
    assert failed.expected
