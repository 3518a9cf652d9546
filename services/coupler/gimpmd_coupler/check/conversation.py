"""Checks of the protocol: registration, lockstep, faults of the bus, checkpoints, and the end."""

from __future__ import annotations

import struct
import time
import zlib
from pathlib import Path

import numpy as np

from gimpmd_coupler.bus.stage import Heard
from gimpmd_coupler.check.bench import RUN, Bench
from gimpmd_coupler.check.log import Log, UnmetError, expect
from gimpmd_coupler.check.partner import Fields, Partner, Peer
from gimpmd_coupler.check.peers import PULSE, Ideal
from gimpmd_coupler.check.rank import Rank
from gimpmd_coupler.exit import FAREWELL_SECONDS
from gimpmd_coupler.participant import OTHER
from gimpmd_schemas.case.interface_nodes import interface_nodes
from gimpmd_schemas.case.plan import CheckpointPlan, Plan
from gimpmd_schemas.checkpoint.manifest import (
    Manifest,
    digest_of,
    folder_of,
    state_file,
    write_manifest,
)
from gimpmd_schemas.wire.messages import (
    PROTOCOL_VERSION,
    Array,
    Grant,
    Payload,
    Refused,
    Register,
    encode,
)

STEPS = PULSE + 6
"""Last step of the runs."""

SAME = 1e-9
"""Largest difference of payloads that should be the same, relative to the largest value."""

REPEAT_SECONDS = 5.0
"""Time after which a rank repeats what was not answered, or asks again for what has not come."""

LOST_SECONDS = 2.0
"""Time after which a broken connection to the coupler counts as lost."""

_SILENT_SECONDS = 0.4  # in which nothing must come
_MARGIN_SECONDS = 3.0
_SAVED_AT = 8
_STRANGER = b"of another request"[:16]


def registration(bench: Bench, log: Log) -> None:
    """Check what the service says of itself, and how it takes a refusal."""
    plan = bench.plan()
    with bench.started("registration", plan) as partner:
        with log.checking("registers with the coupler"):
            messages = partner.register()
        with log.checking("declares its token before it registers"):
            _wait_for_tokens(partner, len(partner.ranks))
        with log.checking(f"speaks version {PROTOCOL_VERSION} of the protocol"):
            for message in messages:
                expect(message.protocol == PROTOCOL_VERSION, f"protocol {PROTOCOL_VERSION}",
                       f"protocol {message.protocol}")  # fmt: skip
        with log.checking("names the run, the plan and its rank"):
            for number, message in enumerate(messages):
                _check_names(message, number, plan, bench)
        with log.checking("offers the nodes that the other side needs, and needs no others"):
            _check_nodes(partner, plan)
        with log.checking("registers again when no answer comes"):
            partner.wait_for(
                lambda: all(len(rank.registrations) > 1 for rank in partner.ranks),
                f"the same request again after {REPEAT_SECONDS:g} s",
                REPEAT_SECONDS + _MARGIN_SECONDS,
            )
            for rank in partner.ranks:
                _check_repeated(rank.registrations)
        with log.checking("ends when it is refused, and says why"):
            reason = f"it speaks protocol {PROTOCOL_VERSION}, the coupler {PROTOCOL_VERSION + 1}"
            partner.refuse(reason)
            partner.wait_for_end(3)
            _check_said(partner, reason)


def _wait_for_tokens(partner: Partner, count: int) -> None:
    partner.wait_for(
        lambda: len(partner.tokens) == count,
        f"the tokens of {' and '.join(rank.name for rank in partner.ranks)}",
        1.0,
    )


def _check_names(message: Register, rank: int, plan: Plan, bench: Bench) -> None:
    for name, value in {
        "run": RUN,
        "plan": plan.digest(),
        "role": bench.role,
        "rank": rank,
        "ranks": plan.ranks(bench.role),
        "units": plan.units,
        "dt": plan.step,
    }.items():
        came = getattr(message, name)
        expect(came == value, f"{name} = {value}", f"{name} = {came}")


def _check_nodes(partner: Partner, plan: Plan) -> None:
    shared = interface_nodes(plan)
    for rank in partner.ranks:
        once = np.unique(rank.needs).size == rank.needs.size
        expect(once, f"needs of {rank.name} with each node once", "doubled nodes")
    for name, ids in (("offers", partner.offers), ("needs", partner.needs)):
        strange = np.setdiff1d(ids, shared)
        wanted = f"{name} among the {shared.size} nodes that ghost atoms touch"
        expect(strange.size == 0, wanted, f"the nodes {strange[:5].tolist()} too")
    twice = partner.offers[:-1][np.diff(partner.offers) == 0]
    expect(twice.size == 0, "offers with each node once, by one rank",
           f"{twice.size} doubled nodes")  # fmt: skip
    missing = np.setdiff1d(shared, partner.offers)
    expect(missing.size == 0, "all nodes that ghost atoms touch in offers",
           f"offers without {missing.size} of them")  # fmt: skip


def _check_repeated(requests: list[Heard]) -> None:
    first, second = requests[0], requests[1]
    expect(second.number == first.number, "the same attachment as before", "another one")
    expect(second.data == first.data, "the same frame as before", "another one")


def _check_said(partner: Partner, text: str) -> None:
    said = partner.process.said()
    expect(text in said, f"{text!r} on standard error", partner.process.state())


def course(bench: Bench, log: Log) -> Partner:
    """Check an ordinary run: lockstep, grants, reports and the stop. Returns what was heard."""
    plan = bench.plan(steps=10 * STEPS)
    with bench.started("course", plan) as partner:
        _begin(partner, last=plan.steps, granted=2)
        peer = Ideal(plan, bench.role, partner.needs).pulse
        with log.checking("sends the payload of the first step"):
            partner.payload(0)
        with log.checking("waits for the payload of the other side"):
            _check_silent(partner, 1)
        with log.checking("waits for a grant"):
            partner.play(peer, 2)
            _check_silent(partner, 3)
        with log.checking("goes on when it may, and reports each step"):
            partner.grant(STEPS)
            partner.play(peer, PULSE + 2)
            active = [rank for rank in partner.ranks if rank.needs.size]
            partner.wait_for(
                lambda: min(rank.reported for rank in active) >= PULSE, f"a report of step {PULSE}"
            )
        with log.checking("stays where it is when grants are taken back"):
            partner.payload(PULSE + 3)
            partner.recall()
            farthest = max(_hold_of(partner, rank) for rank in active)
            partner.play(peer, PULSE + 3)
            _check_silent(partner, PULSE + 4)
        with log.checking("ends at the step that the coupler names"):
            ahead = 0 if len(active) == len(partner.ranks) else len(partner.ranks) - 1
            partner.end_at(-(-(farthest + ahead) // plan.steps_together) * plan.steps_together)
            partner.finish(peer)
            last = partner.steps[-1]
            expect(last == partner.last, f"the payload of step {partner.last} last", f"of {last}")
            partner.wait_for_end(0)
        with log.checking("takes its token back"):
            _wait_for_tokens(partner, 0)
        bench.course.update((step, partner.payload(step)) for step in partner.steps)
        return partner


def _hold_of(partner: Partner, rank: Rank) -> int:
    """Wait until a rank says where it stays. Ranks without nodes may wait for the others."""
    partner.wait_for(lambda: rank.holds is not None, "a report with holds")
    assert rank.holds is not None
    expect(rank.holds == PULSE + 3, f"holds = {PULSE + 3}", f"holds = {rank.holds}")
    return rank.holds


def _begin(partner: Partner, last: int, granted: int, first: int = 0) -> None:
    partner.register()
    partner.accept(last, granted, first)


def _check_silent(partner: Partner, step: int) -> None:
    partner.listen(_SILENT_SECONDS)
    expect(not partner.sent(step), f"no payload of step {step} yet", "this payload")


def disturbances(bench: Bench, log: Log) -> None:
    """Check that frames which are lost, doubled or wrong change nothing."""
    if not bench.course:
        log.leave_out("bears faults of the bus", "there is no undisturbed run to compare with")
        return
    plan = bench.plan(steps=STEPS - 2)
    with bench.started("disturbances", plan) as partner:
        _begin(partner, last=plan.steps, granted=3)
        peer = Ideal(plan, bench.role, partner.needs).pulse
        with log.checking("takes a payload once that comes twice"):
            partner.play(_twice(partner, peer), 3)
            _check_silent(partner, 4)  # it takes both while it waits for a grant
            partner.grant(plan.steps)
        with log.checking("leaves frames alone that are no payload of the other side"):
            partner.payload(4)
            for number, name in enumerate(partner.peers):
                for frame in _wrong_frames(partner, number, peer):
                    partner.stage.send(name, frame)
            _check_silent(partner, 5)
            partner.play(peer, 4)
            partner.payload(5)
        with log.checking("asks again for a payload that was lost"):
            _check_asked(partner, partner.source(5), partner.source(4))
            partner.play(peer, 6)
        with log.checking("sends a payload again when it is asked to"):
            partner.payload(7)
            for rank in partner.ranks:
                partner.stage.ask_again(rank.name, 7)
                partner.stage.ask_again(rank.name, 6)
            for rank in partner.ranks:
                _check_sent_again(partner, rank)
        with log.checking("has no answer when it is asked for a step that it has not sent"):
            for rank in partner.ranks:
                partner.stage.ask_again(rank.name, 9)
            _check_silent(partner, 8)
        with log.checking("leaves answers to requests of others alone"):
            refused = encode(Refused(reason="this is for another process"))
            for rank in partner.ranks:
                partner.stage.answer(rank.name, refused, _STRANGER)
                end = encode(Grant(granted=8, last=8, done=8))
                partner.stage.answer(rank.name, end, _STRANGER)
            partner.play(peer, 10)
        with log.checking("sends a report again that is not answered"):
            _check_report_again(partner, peer)
        with log.checking("takes payloads that come early"):
            start = partner.source(12)
            for step in (start + 1, start + 2, start):
                partner.send(step, peer(step))
            partner.payload(15)
        with log.checking("comes to its end"):
            partner.finish(peer)
            partner.wait_for_end(0)
        with log.checking("sends what it sends without faults"):
            _compare({k: partner.payload(k) for k in partner.steps}, bench.course)


def _check_asked(partner: Partner, wanted: int, before: int) -> None:
    """Check that ranks ask each peer for a step; they may have asked for the one before."""
    for name, steps in partner.asked.items():
        partner.wait_for(
            lambda steps=steps: wanted in steps,  # type: ignore[misc]
            f"step {wanted} on the key again/{name}",
            REPEAT_SECONDS + _MARGIN_SECONDS,
        )
        expect(set(steps) <= {wanted, before}, f"step {wanted} alone", f"the steps {steps}")


def _check_sent_again(partner: Partner, rank: Rank) -> None:
    """Check that a rank with nodes sends its last two payloads again."""
    for step in (6, 7) if rank.offers.size else ():
        again = lambda step=step: len(rank.frames[step]) > 1  # noqa: E731
        partner.wait_for(again, f"the payload of step {step} again")
        first, second = rank.frames[step][:2]
        expect(first == second, "the same frame again", "another one")


def _twice(partner: Partner, peer: Peer) -> Peer:
    """Send each payload of the other side once more, and that of the step before."""

    def fields(step: int) -> Fields:
        for old in (step, step - 1):
            if old >= 0:
                partner.send(old, peer(old))
        return peer(step)

    return fields


def _wrong_frames(partner: Partner, number: int, peer: Peer) -> list[bytes]:
    """Frames that are no payload of a peer, with fields that would be taken for some."""
    step = partner.source(4)
    fields = {name: 10.0 * array + 1.0 for name, array in peer(step).items()}
    right = partner.frame_of(number, step, fields)
    of_another = encode(Payload(role=partner.role, rank=number, step=step), fields)
    of_the_next = encode(Payload(role=OTHER[partner.role], rank=number + 1, step=step), fields)
    altered = bytearray(right)
    altered[-1] ^= 1
    header = b"{" * 8
    lead = struct.pack("<I", len(header)) + header + bytes(4)
    nonsense = b"GMD1" + struct.pack("<I", zlib.crc32(lead)) + lead
    return [
        b"",
        b"garbage",
        b"GMD2" + right[4:],  # of another version
        right[:-8],
        bytes(altered),
        nonsense,
        of_another,
        of_the_next,
        encode(Refused(reason="no payload")),
    ]


def _check_report_again(partner: Partner, peer: Peer) -> None:
    """Leave a report without an answer; steps go on meanwhile, because they are granted."""
    partner.answers_reports = False
    active = [rank for rank in partner.ranks if rank.needs.size]  # the others may wait for them
    known = [len(rank.reports) for rank in active]
    partner.play(peer, 11)
    for rank, count in zip(active, known, strict=True):
        _check_repeated_report(partner, rank, count)
    partner.answers_reports = True
    partner.grant(partner.granted)


def _check_repeated_report(partner: Partner, rank: Rank, known: int) -> None:
    """Wait for a report of a rank beyond those that are known, and for the same once more."""
    partner.wait_for(lambda: len(rank.reports) > known, "a report")
    number = rank.reports[known].number
    partner.wait_for(
        lambda: [one.number for one in rank.reports].count(number) > 1,
        f"the same report again after {REPEAT_SECONDS:g} s",
        REPEAT_SECONDS + _MARGIN_SECONDS,
    )
    first, second = [one.data for one in rank.reports if one.number == number][:2]
    expect(first == second, "the same frame again", "another one")


def _compare(came: dict[int, Fields], expected: dict[int, Fields]) -> None:
    common = sorted(came.keys() & expected.keys())
    for name in expected[common[0]]:
        scale = max(float(np.abs(expected[step][name]).max(initial=0.0)) for step in common)
        for step in common:
            off = float(np.abs(came[step][name] - expected[step][name]).max(initial=0.0))
            wanted = f"{name!r} at step {step} as before, with values up to {scale:.3g}"
            expect(off <= SAME * scale, wanted, f"values that are {off:.2g} off")


def checkpoint(bench: Bench, log: Log) -> None:
    """Check that a state is saved, and that a second run goes on from it."""
    rule = CheckpointPlan(every=_SAVED_AT, seconds=600.0, keep=2)
    plan = bench.plan(steps=2 * _SAVED_AT, checkpoint=rule)
    files = [state_file(bench.role, rank) for rank in range(plan.ranks(bench.role))]
    with bench.started("checkpoint", plan) as partner:
        _begin(partner, last=plan.steps, granted=2)
        peer = Ideal(plan, bench.role, partner.needs).pulse
        with log.checking("saves its state when it is ordered to"):
            partner.play(peer, 2)
            partner.grant(plan.steps, (_SAVED_AT,))
            partner.finish(peer)
            partner.wait_for_end(0)
            for rank in partner.ranks:
                expect(_SAVED_AT in rank.saved, f"a report with saved of step {_SAVED_AT}",
                       f"reports with saved of {sorted(rank.saved) or 'no step'}")  # fmt: skip
        with log.checking("reports the digest of the file"):
            digests = [
                _check_digest(partner.run_dir, name, rank.saved[_SAVED_AT])
                for name, rank in zip(files, partner.ranks, strict=True)
            ]
        first = {step: partner.payload(step) for step in partner.steps}
    write_manifest(
        partner.run_dir,
        Manifest(
            step=_SAVED_AT,
            time=_SAVED_AT * plan.step,
            state=plan.state_digest(),
            ranks={bench.role: len(files)},
            start_energy=None,
            files=dict(zip(files, digests, strict=True)),
        ),
    )
    with bench.started_again(partner.run_dir, plan) as partner:
        with log.checking("registers at the step of the checkpoint"):
            for message in partner.register():
                expect(message.first_step == _SAVED_AT, f"first_step = {_SAVED_AT}",
                       f"first_step = {message.first_step}")  # fmt: skip
        with log.checking("goes on from there to the end"):
            partner.accept(plan.steps, plan.steps, _SAVED_AT)
            if partner.source(_SAVED_AT) > _SAVED_AT:
                partner.send(_SAVED_AT, peer(_SAVED_AT))
            partner.finish(peer)
            partner.wait_for_end(0)
        with log.checking("sends what it has sent before"):
            _compare({k: partner.payload(k) for k in partner.steps}, first)


def _check_digest(run_dir: Path, name: str, reported: str) -> str:
    """Compare what a rank says of its file with the file; returns the digest."""
    path = folder_of(run_dir, _SAVED_AT) / name
    expect(path.is_file(), f"the file {path.relative_to(run_dir)}", "no such file")
    digest = digest_of(path)
    expect(reported == digest, f"SHA-256 {digest}", reported)
    return digest


def silence(bench: Bench, log: Log) -> None:
    """Check what the service does when the other side falls silent and is given up."""
    plan = bench.plan(steps=STEPS)
    with bench.started("silence", plan) as partner:
        peer = _play_some(partner, bench, plan)
        silent, name = len(partner.peers) - 1, partner.peers[-1]
        with log.checking("says whom it waits for"):
            _send_all_but(partner, silent, 4, peer)
            for rank in partner.ranks:
                if silent in rank.links:
                    _check_waiting(partner, rank, name)
        with log.checking("ends when another rank has failed, and names it"):
            partner.refuse(f"{name} was lost at step 4: it is silent", name)
            partner.wait_for_end(3)
            expect(partner.failure is None, "no request Failed after Refused", "such a request")
            _check_said(partner, name)


def _send_all_but(partner: Partner, silent: int, step: int, peer: Peer) -> None:
    """Send what the service takes at a step, except from one peer."""
    step = partner.source(step)
    for number in range(len(partner.peers)):
        if number != silent:
            partner.send_of(number, step, peer(step))


def _check_waiting(partner: Partner, rank: Rank, name: str) -> None:
    """Check that a rank says that it waits for a peer."""
    partner.wait_for(
        lambda: name in rank.waits_for,
        f"a report in which {rank.name} waits for {name}",
        _MARGIN_SECONDS,
    )


def _play_some(partner: Partner, bench: Bench, plan: Plan) -> Peer:
    """Come some steps into a run; the rank then waits for a payload."""
    _begin(partner, last=plan.steps, granted=plan.steps)
    peer = Ideal(plan, bench.role, partner.needs).pulse
    partner.play(peer, 3)
    partner.payload(4)
    return peer


def wrong_fields(bench: Bench, log: Log) -> None:
    """Check that the service notices fields that cannot be right, and says who sent them."""
    plan = bench.plan(steps=STEPS)
    for what, spoil in (("not finite", _not_finite), ("of a wrong shape", _cut_short)):
        with bench.started(f"fields {what}".replace(" ", "-"), plan) as partner:
            peer = _play_some(partner, bench, plan)
            with log.checking(f"names the rank that sends a field that is {what}"):
                partner.bear_failure()
                bad, name, step = len(partner.peers) - 1, partner.peers[-1], partner.source(4)
                _send_all_but(partner, bad, 4, peer)
                partner.send_of(bad, step, {k: spoil(v) for k, v in peer(step).items()})
                partner.wait_for(lambda: partner.failure, "a request Failed")
                assert partner.failure is not None
                culprit = partner.failure.culprit
                expect(culprit == name, f"culprit = {name!r}", f"culprit = {culprit!r}")
                failed = f"{partner.failure.role}/{partner.failure.rank}"
                partner.refuse(partner.failure.message, failed)  # for the other ranks
                partner.wait_for_end(3)


def _not_finite(array: Array) -> Array:
    spoilt = array.copy()
    spoilt[-1] = np.nan
    return spoilt


def _cut_short(array: Array) -> Array:
    return array[:-1]


def lost_coupler(bench: Bench, log: Log) -> None:
    """Check that the service ends by itself when the coupler is gone."""
    plan = bench.plan(steps=STEPS)
    with bench.started("lost-coupler", plan) as partner:
        _play_some(partner, bench, plan)
        with log.checking("ends when the coupler is gone, and says so"):
            partner.stage.close()
            begun = time.monotonic()
            together = FAREWELL_SECONDS if len(partner.ranks) > 1 else 0.0
            if not partner.process.wait(LOST_SECONDS + together + bench.deadline):
                raise UnmetError(
                    f"the end of the service {LOST_SECONDS:g} s after the coupler is gone",
                    f"a service that runs after {time.monotonic() - begun:.1f} s",
                )
            partner.wait_for_end(3)
            _check_said(partner, "coupler")
