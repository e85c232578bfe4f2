"""A process that runs trials, and the two sides of the talk with it.

It reads a JSON line for each trial from its stdin, and answers on a pipe that
nobody else knows of: whatever is printed cannot get in between.  First it says
that it begins, and then the row; or only why it must not make that row.  It
ends with its stdin, and so with its parent, however that ends.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing.connection import wait

from diagrams.envelope.fingerprints import robot_hash, this_code
from diagrams.envelope.trial import run_trial
from diagrams.scenario import Scenario
from nadia_balance.typed_yaml import load_typed

BEGUN = "begun"
ORPHAN_GRACE = 10.0  # so long after its time is up a child ends itself [s]
LAST_WORDS = 300  # so many bytes at most are told of its stderr

_SIGNALS = {-number: number.name for number in signal.Signals}


class TrialChild:
    """The parent's side."""

    def __init__(self):
        self.trials = 0
        self._stderr = tempfile.TemporaryFile(buffering=0)
        replies, their_end = os.pipe()
        # Unbuffered: two lines may come at once, and wait sees only the pipe.
        self._replies = open(replies, "rb", buffering=0)
        module = "diagrams.envelope.trial_child"
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, str(their_end)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._stderr,
                bufsize=0,
                env=os.environ | _environment(),
                pass_fds=[their_end],
                start_new_session=True,  # Ctrl-C is for the parent alone
            )
        finally:
            os.close(their_end)

    @property
    def is_alive(self) -> bool:
        """True until it ends."""
        return self.process.poll() is None

    def ask(self, request: dict, timeout: float) -> str:
        """Returns the row as JSON, empty if the child died in the trial.

        Raises:
            TimeoutError: there was none for `timeout` [s].
            RuntimeError: it does not begin with the trial; why.
        """
        end = time.monotonic() + timeout
        if self.trials:
            # The child writes at the same offset: its last words are of this
            # trial, or of its start.
            self._stderr.seek(0)
            self._stderr.truncate()
        self.trials += 1
        with contextlib.suppress(BrokenPipeError):  # dead: no reply, either
            self.process.stdin.write(f"{json.dumps(request)}\n".encode())
        if (answer := self._line(end)) != BEGUN:
            raise RuntimeError(answer or self.death())
        return self._line(end)

    def death(self) -> str:
        """How it died, once there is no reply: SIGSEGV: its last words."""
        code = self.process.wait()
        said = self._stderr.seek(0, os.SEEK_END)
        self._stderr.seek(max(0, said - LAST_WORDS))
        lines = self._stderr.read().decode(errors="replace").split("\n")
        words = [line.strip() for line in lines if line.strip()][-1:]
        return ": ".join([_SIGNALS.get(code, f"exit code {code}"), *words])

    def close(self) -> None:
        """Ends it, unless it has ended."""
        self.process.kill()
        self.process.wait()
        for file in (self.process.stdin, self._replies, self._stderr):
            file.close()

    def _line(self, end: float) -> str:
        """The next one, empty if the child died; `end`: time.monotonic()."""
        if not wait([self._replies], end - time.monotonic()):
            raise TimeoutError
        line = self._replies.readline().decode()
        return line.strip() if line.endswith("\n") else ""


def _environment() -> dict[str, str]:
    """One thread for each trial; and the modules of this very process."""
    return {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join(sys.path),
    }


def serve(descriptor: int) -> None:
    """Runs the trials that stdin asks for; answers on `descriptor`."""
    code = this_code()  # that was imported; later there may be another
    with (
        contextlib.suppress(BrokenPipeError),  # without parent, nobody reads
        open(descriptor, "w", encoding="utf-8", errors="replace") as replies,
    ):
        for line in sys.stdin:
            request = json.loads(line)
            # The parent ends it much sooner, if it is still there.
            limit = request["timeout"] + ORPHAN_GRACE
            signal.setitimer(signal.ITIMER_REAL, limit)
            for answer in _answers(request, code):
                print(answer, file=replies, flush=True)
            signal.setitimer(signal.ITIMER_REAL, 0.0)


def _answers(request: dict, code: dict[str, str]) -> Iterator[str]:
    try:
        scenario = load_typed(Scenario, "scenario", data=request["scenario"])
        ours = {**code, "robot_files": robot_hash(scenario.robot)}
        _compare(ours, request["identity"])
    except (ValueError, OSError) as error:
        yield " ".join(str(error).split())
        return
    yield BEGUN
    yield json.dumps(run_trial(scenario, request["plant"]), allow_nan=False)


def _compare(ours: dict[str, str], asked: dict) -> None:
    """Raises ValueError naming what is not as in the sweep."""
    for name, value in ours.items():
        if asked.get(name, value) != value:
            raise ValueError(
                f"{name} = {value}: must be {asked[name]}, as when the sweep "
                "began"
            )


if __name__ == "__main__":
    serve(int(sys.argv[1]))
