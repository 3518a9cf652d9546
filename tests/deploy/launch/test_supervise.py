"""The supervisor with stand-in children that end, fail, die by a signal, or hang."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import psutil
import pytest

from gimpmd_deploy.launch.processes import Service
from gimpmd_deploy.launch.supervise import Deadlines, supervise
from gimpmd_schemas.errors import BackendError, PeerLostError
from gimpmd_schemas.wire.events import Event, Listening

QUICK = Deadlines(listen=5.0, stop=5.0, leave=5.0, grace=1.0, terminate=0.5, kill=1.0)

# what the stand-ins may use: say(event), and reading one line of standard input
PRELUDE = """
import json, os, signal, sys, time
def say(type, **fields):
    print(json.dumps({"type": type, **fields}), flush=True)
"""
LISTEN = 'say("Listening", endpoint="tcp/127.0.0.1:1")\n'
PROGRESS = 'say("Progress", step=120, last_step=750, time=9.6)\n'
OBEY = 'sys.stdin.readline()\nsay("Ended", step=121, time=9.68, stopped=True)\n'
HANG = "time.sleep(60)\n"
DEAF = "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"


class Notes:
    """A watcher that remembers."""

    def __init__(self):
        self.events: list[Event] = []
        self.when = []
        self.said: list[str] = []

    def event(self, event):
        self.events.append(event)
        for name, action in self.when:
            if type(event).__name__ == name:
                action()

    def say(self, text):
        self.said.append(text)

    def tick(self):
        pass


@pytest.fixture
def play(tmp_path: Path):
    """Run stand-ins: the coupler's program and those of services by name."""

    def service(name: str, program: str) -> Service:
        return Service(
            name,
            [sys.executable, "-c", PRELUDE + textwrap.dedent(program)],
            tmp_path / f"{name}.log",
            tmp_path,
        )

    def play(coupler, services=None, deadlines=QUICK, watcher=None, inherits=()):
        others = [service(name, program) for name, program in (services or {}).items()]
        return supervise(
            service("coupler", coupler),
            lambda _: others,
            watcher or Notes(),
            deadlines,
            inherits,
        )

    yield play
    children = psutil.Process().children(recursive=True)
    assert children == [], "processes were left behind"


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)


def test_events_reach_the_watcher_and_services_the_endpoint(play, tmp_path):
    notes = Notes()
    outcome = play(
        LISTEN + PROGRESS + 'say("Ended", step=750, time=60.0, stopped=False)',
        {"md": 'print("hello")', "gimp": ""},
        watcher=notes,
    )
    assert (outcome.step, outcome.time, outcome.stopped) == (750, 60.0, False)
    assert notes.events[0] == Listening("tcp/127.0.0.1:1")
    assert [type(event).__name__ for event in notes.events] == ["Listening", "Progress", "Ended"]
    assert (tmp_path / "md.log").read_text() == "hello\n"


def test_what_is_no_event_goes_to_the_log(play, tmp_path):
    play(LISTEN + 'print("some words")\nsay("Ended", step=1, time=1.0, stopped=False)')
    assert "some words" in (tmp_path / "coupler.log").read_text()


def test_a_run_that_a_defect_ended_says_so(play):
    ended = 'say("Ended", step=7, time=0.5, stopped=True, defect="a crack")'
    outcome = play(LISTEN + ended)
    assert (outcome.stopped, outcome.defect) == (True, "a crack")


def test_interrupt_stops_at_the_next_step(play):
    notes = Notes()
    notes.when.append(("Progress", interrupt))
    outcome = play(LISTEN + PROGRESS + OBEY, {"md": "time.sleep(0.5)"}, watcher=notes)
    assert (outcome.step, outcome.time) == (121, 9.68)
    assert outcome.stopped
    assert not outcome.forced
    assert ["stopping at the next step" in text for text in notes.said] == [True]


def test_sigterm_stops_it_too(play):
    notes = Notes()
    notes.when.append(("Progress", lambda: os.kill(os.getpid(), signal.SIGTERM)))
    assert play(LISTEN + PROGRESS + OBEY, watcher=notes).stopped


def test_second_interrupt_ends_at_once(play):
    notes = Notes()
    notes.when.append(("Progress", interrupt))
    notes.when.append(("Progress", lambda: threading.Timer(0.4, interrupt).start()))
    begin = time.monotonic()
    outcome = play(LISTEN + PROGRESS + HANG, {"md": HANG}, watcher=notes)
    assert time.monotonic() - begin < 4.0
    assert (outcome.step, outcome.time) == (120, 9.6)
    assert outcome.forced


def test_run_that_does_not_stop_is_ended(play):
    notes = Notes()
    notes.when.append(("Progress", interrupt))
    quick = Deadlines(stop=0.5, terminate=0.3, kill=1.0)
    outcome = play(LISTEN + PROGRESS + DEAF + HANG, {"md": DEAF + HANG}, quick, notes)
    assert outcome.forced


@pytest.mark.parametrize(
    ("program", "how"),
    [
        ("os.kill(os.getpid(), signal.SIGKILL)", "was killed by SIGKILL"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "was killed by SIGSEGV"),
        ("sys.exit(5)", "ended with exit code 5"),
        ('raise ValueError("no such potential")', "ValueError: no such potential"),
    ],
)
def test_service_that_dies_is_named(play, program, how):
    begin = time.monotonic()
    with pytest.raises(PeerLostError, match="md was lost at step 120") as caught:
        play(LISTEN + PROGRESS + HANG, {"md": "time.sleep(0.5)\n" + program, "gimp": HANG})
    assert how in str(caught.value)
    assert "  File" not in str(caught.value)
    assert time.monotonic() - begin < 5.5


def test_all_end_within_five_seconds_even_if_they_resist(play):
    killed = "time.sleep(0.3)\nos.kill(os.getpid(), signal.SIGKILL)"
    begin = time.monotonic()
    with pytest.raises(PeerLostError, match="md was lost"):
        play(LISTEN + DEAF + HANG, {"md": killed, "gimp": DEAF + HANG}, Deadlines())
    assert time.monotonic() - begin < 0.3 + 5.0 + 0.5


def test_coupler_killed_is_named_and_not_its_victims(play):
    program = LISTEN + PROGRESS + "time.sleep(0.5)\nos.kill(os.getpid(), signal.SIGKILL)"
    victim = "time.sleep(0.6)\nsys.exit(3)"
    with pytest.raises(PeerLostError, match="coupler was lost at step 120") as caught:
        play(program, {"md": victim, "gimp": victim})
    assert "SIGKILL" in str(caught.value)


def test_a_killed_coupler_leaves_no_socket_behind(play, tmp_path):
    """Zenoh makes a file ``bus.lock`` beside the socket."""
    folder = tmp_path / "gimpmd-1234"
    folder.mkdir()
    for name in ("bus", "bus.lock"):
        (folder / name).touch()
    listen = f'say("Listening", endpoint="unixsock-stream/{folder}/bus")\n'
    with pytest.raises(PeerLostError, match="coupler was lost"):
        play(listen + "os.kill(os.getpid(), signal.SIGKILL)", {"md": HANG})
    assert not folder.exists()


def test_coupler_names_the_rank(play):
    lost = 'time.sleep(0.3)\nsay("Lost", who="md/1", step=7, reason="its session ended")\n'
    with pytest.raises(PeerLostError, match="md/1 was lost at step 7: its session ended"):
        play(LISTEN + lost + "sys.exit(3)", {"md": "time.sleep(0.4)\nsys.exit(9)", "gimp": HANG})


@pytest.mark.parametrize(("code", "error"), [(2, BackendError), (3, PeerLostError)])
def test_service_that_says_why_it_failed(play, code, error):
    words = "Unknown pair style"
    failed = f'say("ServiceFailed", who="md/0", message="{words}", exit_code={code})\n'
    with pytest.raises(error, match=f"md/0: {words}") as caught:
        play(LISTEN + failed + "sys.exit(3)", {"md": f"sys.exit({code})"})
    assert caught.value.exit_code == code


def test_bad_input_without_a_word_of_the_coupler(play):
    refuse = 'print("ERROR: Unknown pair style", file=sys.stderr)\nsys.exit(2)'
    with pytest.raises(BackendError, match="Unknown pair style"):
        play(LISTEN + HANG, {"md": refuse})


def test_coupler_that_does_not_listen(play):
    quick = Deadlines(listen=0.3, terminate=0.3, kill=1.0)
    with pytest.raises(PeerLostError, match=r"coupler did not open the bus within 0\.3 s"):
        play(HANG, deadlines=quick)


def test_coupler_that_leaves_without_a_word(play):
    with pytest.raises(PeerLostError, match="without saying"):
        play(LISTEN)


def test_service_that_stays_after_the_end(play):
    quick = Deadlines(leave=0.4, terminate=0.3, kill=1.0)
    with pytest.raises(PeerLostError, match=r"gimp did not end within 0\.4 s after the run"):
        play(LISTEN + 'say("Ended", step=1, time=1.0, stopped=False)', {"gimp": HANG}, quick)


def test_service_that_leaves_early(play):
    quick = Deadlines(leave=0.4, terminate=0.3, kill=1.0)
    with pytest.raises(PeerLostError, match="did not end although md did"):
        play(LISTEN + HANG, {"md": ""}, quick)


def test_command_that_does_not_exist(tmp_path):
    service = Service("coupler", ["/nowhere/gimpmd"], tmp_path / "log", tmp_path)
    with pytest.raises(PeerLostError, match="coupler cannot be started: No such file"):
        supervise(service, lambda _: [], Notes(), QUICK)


def test_grandchildren_end_too(play):
    program = "import subprocess\nsubprocess.Popen([sys.executable, '-c', 'import time; "
    program += "time.sleep(60)'], start_new_session=True)\ntime.sleep(60)"
    failed = 'time.sleep(1.0)\nsay("Lost", who="gimp/0", step=1, reason="silent")\n'
    with pytest.raises(PeerLostError):
        play(LISTEN + failed + HANG, {"md": program})


def test_a_thread_cannot_catch_signals_but_can_run(play):
    outcomes = []
    program = LISTEN + 'say("Ended", step=1, time=1.0, stopped=False)'
    thread = threading.Thread(target=lambda: outcomes.append(play(program)))
    thread.start()
    thread.join()
    assert [outcome.step for outcome in outcomes] == [1]


ALIVE = 'say("Alive")\n'
FREEZE = "os.kill(os.getpid(), signal.SIGSTOP)\n"
SOON = Deadlines(leave=5.0, grace=1.0, terminate=0.3, kill=1.0, silence=60.0, suspicion=1.0)


def test_a_frozen_coupler_is_named(play):
    begin = time.monotonic()
    with pytest.raises(PeerLostError, match="coupler was lost at step 120: its process is stopped"):
        play(LISTEN + PROGRESS + ALIVE + FREEZE, {"md": HANG, "gimp": HANG}, SOON)
    assert time.monotonic() - begin < 10.0


def test_a_frozen_coupler_is_named_and_not_the_services_that_end_without_it(play):
    victim = "time.sleep(0.7)\nsys.exit(3)"
    with pytest.raises(PeerLostError, match="coupler was lost at step 120: its process is stopped"):
        play(LISTEN + PROGRESS + ALIVE + FREEZE, {"md": victim, "gimp": victim}, SOON)


def test_a_coupler_that_hangs_without_a_sign_of_life(play):
    quick = Deadlines(terminate=0.3, kill=1.0, silence=1.5, suspicion=0.5)
    with pytest.raises(PeerLostError, match="its process is sleeping and gave no sign of life"):
        play(LISTEN + ALIVE + HANG, {"md": HANG}, quick)


def test_the_time_in_which_the_supervisor_itself_is_stopped_does_not_count(play):
    """It goes on when a signal wakes it; the signs of life have waited in the pipe."""
    notes = Notes()
    stopped = "kill -STOP {0}; sleep 2.5; kill -CONT {0}".format(os.getpid())

    def stop():
        subprocess.Popen(["sh", "-c", stopped]).wait()

    notes.when.append(("Progress", stop))
    beats = "for _ in range(8):\n    say('Alive')\n    time.sleep(0.5)\n"
    ended = 'say("Ended", step=750, time=60.0, stopped=False)'
    quick = Deadlines(silence=1.5, suspicion=1.0)
    assert play(LISTEN + PROGRESS + beats + ended, watcher=notes, deadlines=quick).step == 750


def test_the_coupler_is_told_of_a_service_that_ends_and_its_log_is_shown(play, tmp_path):
    """The coupler cannot know of ranks that die before they have registered."""
    obey = """
    words = sys.stdin.readline().split(maxsplit=2)
    print(words, file=sys.stderr)
    say("Lost", who=words[1], step=0, reason=words[2].strip())
    sys.exit(3)
    """
    dies = 'print("no such potential", file=sys.stderr)\nos.kill(os.getpid(), signal.SIGKILL)'
    with pytest.raises(PeerLostError, match="md was lost before the first step: it was killed by"):
        play(LISTEN + textwrap.dedent(obey), {"md": dies, "gimp": HANG})
    said = (tmp_path / "coupler.log").read_text()
    assert "'lost', 'md', 'it was killed by SIGKILL end of" in said
    assert "no such potential" in said


def test_a_service_that_ends_early_without_an_error_is_told_too(play):
    obey = 'words = sys.stdin.readline().split(maxsplit=2)\nsay("Lost", who=words[1], step=0, '
    obey += 'reason="")\nsys.exit(3)'
    with pytest.raises(PeerLostError, match="md was lost before the first step: it ended with"):
        play(LISTEN + obey, {"md": "", "gimp": HANG})


def test_the_log_of_a_lost_continuum_rank_is_shown(play):
    lost = 'time.sleep(0.5)\nsay("Lost", who="continuum/0", step=7, reason="its process is gone")\n'
    dies = 'print("no space left", file=sys.stderr)\nsys.exit(9)'
    with pytest.raises(PeerLostError, match=r"continuum/0 was lost at step 7") as caught:
        play(LISTEN + lost + "sys.exit(3)", {"gimp": dies})
    assert "gimp ended with exit code 9" in str(caught.value)
    assert "no space left" in str(caught.value)


def test_all_processes_keep_the_files_that_they_are_to_inherit(play, tmp_path):
    with (tmp_path / "kept").open("w") as kept:
        write = f"os.write({kept.fileno()}, b'x')\n"
        ended = 'time.sleep(0.5)\nsay("Ended", step=1, time=1.0, stopped=False)'
        play(LISTEN + write + ended, {"md": write}, inherits=[kept.fileno()])
    assert (tmp_path / "kept").read_text() == "xx"
