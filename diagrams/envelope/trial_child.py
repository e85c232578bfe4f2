"""A process that runs trials, and the two sides of the talk with it.

It reads a JSON line for each trial from its stdin, and answers with one on a
pipe that nobody else knows of: whatever is printed cannot get in between.  It
ends with its stdin, and so with its parent, however that ends.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
from multiprocessing.connection import wait

from diagrams.envelope.trial import row_without_run, run_trial
from diagrams.scenario import Scenario
from nadia_balance.typed_yaml import load_typed

ORPHAN_GRACE = 10.0  # so long after its time is up a child ends itself [s]
LAST_WORDS = 300  # so many bytes at most are told of its stderr

_SIGNALS = {-number: number.name for number in signal.Signals}


class TrialChild:
    """The parent's side."""

    def __init__(self):
        self.trials = 0
        self._stderr = tempfile.TemporaryFile(buffering=0)
        replies, their_end = os.pipe()
        self._replies = open(replies, encoding="utf-8")
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
        """Returns the reply, empty if the child died.

        Raises:
            TimeoutError: there was none for `timeout` [s].
        """
        self.trials += 1
        # The child writes at the same offset: its last words are of this trial.
        self._stderr.seek(0)
        self._stderr.truncate()
        with contextlib.suppress(BrokenPipeError):  # dead: no reply, either
            self.process.stdin.write(f"{json.dumps(request)}\n".encode())
        if not wait([self._replies], timeout):
            raise TimeoutError
        reply = self._replies.readline()
        return reply if reply.endswith("\n") else ""

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


def _environment() -> dict[str, str]:
    """One thread for each trial; and the modules of this very process."""
    return {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join(sys.path),
    }


def serve(descriptor: int) -> None:
    """Runs the trials that stdin asks for; writes rows to `descriptor`."""
    # Without its parent, nobody reads.
    with contextlib.suppress(BrokenPipeError), open(descriptor, "w") as replies:
        for line in sys.stdin:
            request = json.loads(line)
            # The parent ends it much sooner, if it is still there.
            limit = request["timeout"] + ORPHAN_GRACE
            signal.setitimer(signal.ITIMER_REAL, limit)
            row = _row(request["scenario"], request["plant"])
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            print(json.dumps(row, allow_nan=False), file=replies, flush=True)


def _row(scenario_yaml: str, plant: str) -> dict:
    try:
        scenario = load_typed(Scenario, "scenario", data=scenario_yaml)
    except ValueError as error:
        return row_without_run("error", str(error))
    return run_trial(scenario, plant)


if __name__ == "__main__":
    serve(int(sys.argv[1]))
