"""One program at a time; the oracle is another process."""

import signal
import subprocess
import sys

import pytest

from diagrams.envelope.folder_lock import alone_in
from tests.scripts.running import environment

HOLDER = """
import sys
from pathlib import Path
from diagrams.envelope.folder_lock import alone_in
with alone_in(Path(sys.argv[1])):
    print("in", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, tmp_path],
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as child:
        assert child.stdout.readline() == "in\n"
        yield child
        child.kill()


def test_keeps_a_second_one_out(holder, tmp_path):
    with pytest.raises(ValueError) as refused, alone_in(tmp_path):
        raise AssertionError("both are in")
    assert str(refused.value) == (
        f"out = {str(tmp_path)!r}: must not be in use by another sweep"
    )


@pytest.mark.parametrize("end", [signal.SIGKILL, None])
def test_lets_the_next_one_in_however_the_first_one_ends(holder, tmp_path, end):
    if end:
        holder.send_signal(end)
    else:
        holder.stdin.close()
    holder.wait()
    with alone_in(tmp_path):
        pass
    with alone_in(tmp_path):
        assert list(tmp_path.iterdir()) == [], "it leaves nothing behind"
