"""The command ``gimpmd-coupler``: opens the bus and serves one run.

It prints events to standard output, one JSON object per line. SIGTERM and SIGINT end the run at the
step at which its ranks then stand. With ``--supervised``, a line ``stop`` on standard input and the
end of standard input do the same, and a line ``lost SERVICE REASON`` says that the processes of a
service have ended.
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
import threading
import time
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

from gimpmd_coupler.announcer import emit, start_beating
from gimpmd_coupler.arguments import add_keys, keys_of
from gimpmd_coupler.bus.hub import open_hub
from gimpmd_coupler.bus.refusals import refusals
from gimpmd_coupler.bus.settings import check_run_id
from gimpmd_coupler.checkpoints import Checkpoints
from gimpmd_coupler.coupler import Coupler
from gimpmd_coupler.frame_writer import FrameWriter
from gimpmd_coupler.recorder import Recorder, conclude
from gimpmd_schemas.case.cautions import cautions
from gimpmd_schemas.case.form import Role
from gimpmd_schemas.case.plan import load_plan
from gimpmd_schemas.checkpoint.manifest import RECORD, check_whole, committed
from gimpmd_schemas.errors import STOPPED, DefectError, GimpmdError, StorageError
from gimpmd_schemas.on_disk import folder_of_logs
from gimpmd_schemas.run_lock import take_lock
from gimpmd_schemas.wire.access import TLS
from gimpmd_schemas.wire.events import Ended, Listening, ServiceFailed
from gimpmd_schemas.wire.recording import RECORDING

log = logging.getLogger(__name__)


def _read_commands(coupler: Coupler) -> None:
    """Carry out the commands on standard input until it ends."""
    text = b""
    while chunk := os.read(0, 4096):  # not sys.stdin: its lock would delay the exit
        *lines, text = (text + chunk).split(b"\n")
        for line in lines:
            match line.decode(errors="replace").split(maxsplit=2):
                case ["stop"]:
                    coupler.stop()
                case ["lost", service, reason]:
                    coupler.lost(service, reason)
                case _:
                    log.warning("unknown command %r; there are stop and lost", line)
    coupler.stop()


def serve(options: argparse.Namespace) -> int:
    """Serve a run to its end; returns the exit code.

    Raises
    ------
    InputError
        The plan of the run cannot be read, the coupler cannot listen at the endpoint, or a run is
        going on in the folder.
    PeerLostError, ProtocolError
        The run cannot go on; the message names the rank that caused it.
    StorageError
        ``run.h5`` or the recording cannot be written.
    """
    run_dir, run = options.run_dir, options.run
    plan = load_plan(run_dir / "plan.yaml")
    text = (run_dir / "case.yaml").read_text(encoding="utf-8")
    with ExitStack() as resources:
        if options.supervised:
            start_beating()
        else:
            resources.enter_context(take_lock(run_dir))
        start = next(iter(committed(run_dir)), None)
        earlier = None if start is None else (check_whole(run_dir, start, RECORD), start.step)
        record = Recorder(run_dir / "run.h5", text, plan.units, earlier)
        recorder = resources.enter_context(record)
        checkpoints = Checkpoints(run_dir, plan, time.monotonic())
        frames = None
        if plan.record:
            frames = FrameWriter(run_dir / RECORDING, 0 if start is None else start.step)
            resources.callback(frames.close)
        coupler = Coupler(run, plan, emit, recorder, checkpoints, options.deadline, start, frames)
        if options.supervised:
            threading.Thread(target=_read_commands, args=(coupler,), daemon=True).start()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: coupler.stop())
        take_payload = None if frames is None else frames.take
        ranks: dict[Role, int] = {role: plan.ranks(role) for role in plan.roles}
        hub = open_hub(run, coupler.take, options.listen, keys_of(options), take_payload, ranks)
        where = resources.enter_context(hub)
        log.info("run %s listens on %s", run, where)
        if start is not None:
            log.info("the run goes on at step %d", start.step)
        for caution in cautions(plan):
            log.warning("%s", caution)
        emit(Listening(where))
        try:
            coupler.run()
            if frames is not None:
                frames.flush()
            early, defect = coupler.stopped_early(), coupler.defect()
            reason = (
                "stopped: a monitor found that the results are not reliable"
                if defect
                else "stopped"
            )
            recorder.close(reason if early else "completed")
        except StorageError as error:
            coupler.refuse_all(str(error), "coupler")
            emit(ServiceFailed("coupler", str(error), error.exit_code))
            recorder.drop()
            with suppress(StorageError):  # readers take the outcome "running" for lost then
                conclude(run_dir / "run.h5", f"failed: {error}")
            coupler.linger()
            raise
        except GimpmdError as error:
            recorder.close(f"failed: {error}")
            coupler.linger()
            raise
        except Exception as error:  # such as a lack of memory, which libraries report in many ways
            reason = f"{type(error).__name__}: {error}"
            coupler.refuse_all(f"the coupler failed: {reason}", "coupler")
            emit(ServiceFailed("coupler", reason, GimpmdError.exit_code))
            coupler.linger()
            raise
        emit(Ended(*coupler.position(), early, defect))
        coupler.linger()
    if defect:
        return DefectError.exit_code
    return STOPPED if early else 0


def main() -> int:
    """Entry point of ``gimpmd-coupler``; returns the exit code, see `errors`."""
    parser = argparse.ArgumentParser(prog="gimpmd-coupler", description=__doc__)
    parser.add_argument("--run-dir", type=Path, required=True, help="folder of the run")
    parser.add_argument("--run", type=check_run_id, required=True, help="id of the run")
    parser.add_argument(
        "--listen",
        default="",
        metavar="ENDPOINT",
        help="unixsock-stream/PATH or tls/HOST:PORT (default: a Unix socket in a new folder)",
    )
    add_keys(parser)
    parser.add_argument(
        "--supervised", action="store_true", help="take commands from standard input"
    )
    parser.add_argument(
        "--deadline",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="without progress for so long it says whom it waits for; it gives up after ten times"
        " as long (default: %(default)g; six times longer before the first steps are done); inf: it"
        " waits for every process that is alive",
    )
    options = parser.parse_args()
    try:
        logging.basicConfig(
            filename=folder_of_logs(options.run_dir) / "coupler.log",
            level=logging.INFO,
            format="%(asctime)s %(levelname)s %(message)s",
        )
        tls = options.listen.startswith(f"{TLS}/")
        with refusals(partial(log.warning, "%s"), tls):
            return serve(options)
    except GimpmdError as error:
        log.error("%s", error)
        print(f"gimpmd-coupler: {error}", file=sys.stderr)
        return error.exit_code
    except Exception as error:
        log.exception("the coupler failed")
        print(f"gimpmd-coupler: {error}", file=sys.stderr)
        return GimpmdError.exit_code


if __name__ == "__main__":
    sys.exit(main())
