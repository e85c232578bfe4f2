"""The folder of a run: its log, summary, scenario, replay and plots."""

import contextlib
import fcntl
import itertools
import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

import matplotlib as mpl
import numpy as np
from pydrake.geometry import Meshcat

from nadia_balance.results.log import Log
from nadia_balance.results.pages import replay_status, write_replay
from nadia_balance.results.plots import footsteps, over_time
from nadia_balance.results.plots.style import RC

PLOTS = {
    "timeline.png": over_time.draw_contacts,
    "footsteps.png": footsteps.draw,
    "icp.png": over_time.draw_icp,
    "effort.png": over_time.draw_effort,
    "estimate.png": over_time.draw_estimate,
}

# All files that a run may write.
FILES = ("replay.html", "log.npz", "summary.json", "scenario.yaml", *PLOTS)


@contextlib.contextmanager
def new_folder(
    out: str | os.PathLike | None, name: str = "run", files: Sequence = FILES
) -> Iterator[Path]:
    """Yields the folder `out` (see prepare_folder), locked, for new `files`.

    Raises ValueError: a file exists, another run has the lock, or as there.
    """
    with locked(prepare_folder(out, name)) as folder:
        for file in files:
            if (folder / file).exists():
                raise ValueError(
                    f"out = {str(out)!r}: must be a folder without {file}"
                )
        yield folder


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """Yields `folder`, which no other process has within the block.

    Raises ValueError: another process has it.
    """
    lock = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f"out = {str(folder)!r}: must be in use by no other run"
            ) from None
        yield folder
    finally:
        os.close(lock)


def prepare_folder(out: str | os.PathLike | None, name: str = "run") -> Path:
    """Creates the folder `out`, by default runs/<date>_<time>_<name>.

    Raises ValueError: it cannot be created, or is not writable.
    """
    now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    folder = Path(f"runs/{now}_{name}" if out is None else out)
    try:
        for number in itertools.count(2):
            if out is not None or not folder.exists():
                break
            folder = Path(f"runs/{now}_{name}_{number}")  # in the same second
        folder.mkdir(parents=True, exist_ok=out is not None)
        # A test write also detects a full disk, unlike permissions.
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"x")
            file.flush()
    except (OSError, ValueError, RecursionError) as error:  # too deep
        why = getattr(error, "strerror", None) or str(error)
        raise ValueError(
            f"out = {str(folder)!r}: must be a folder to write to ({why})"
        ) from error
    return folder


def write_run(
    folder: Path,
    log: Log,
    summary: dict,
    scenario: str,
    meshcat: Meshcat | None = None,
) -> list[str]:
    """Writes the files of a run into `folder`; returns their names.

    `scenario` is the YAML of the scenario.  With a `meshcat`, its recording
    becomes the replay.

    Raises OSError: a file cannot be written; then none is.
    """
    with appearing(folder) as drafts:
        if meshcat is not None:
            status = replay_status(log, summary)
            write_replay(meshcat, drafts / "replay.html", status)
        np.savez(drafts / "log.npz", **log)
        text = json.dumps(summary, indent=2, allow_nan=False)
        (drafts / "summary.json").write_text(f"{text}\n", encoding="utf-8")
        (drafts / "scenario.yaml").write_text(scenario, encoding="utf-8")
        write_plots(drafts, log, summary)
    return [name for name in FILES if (folder / name).exists()]


@contextlib.contextmanager
def appearing(folder: Path) -> Iterator[Path]:
    """Yields a temporary folder whose files then move to `folder`, complete.

    Raises OSError: a file cannot be written; then none appears in `folder`.
    """
    with tempfile.TemporaryDirectory(prefix=".", dir=folder) as place:
        drafts = Path(place)
        yield drafts
        for draft in sorted(drafts.iterdir()):
            draft.replace(folder / draft.name)


def write_plots(folder: Path, log: Log, summary: dict) -> list[str]:
    """Draws every plot that the log has the data for; returns their names."""
    written = []
    if len(log["t"]) < 2:
        return written
    with mpl.rc_context():
        mpl.rcdefaults()  # not the user's, such as text.usetex
        mpl.rcParams.update(RC)
        for name, draw in PLOTS.items():
            figure = draw(log, summary)
            if figure is not None:
                figure.savefig(folder / name)
                written.append(name)
    return written


def read_run(folder: Path) -> tuple[dict[str, np.ndarray], dict]:
    """Returns the log and the summary of a run."""
    # Opened here, because numpy does not close a corrupt archive.
    with (
        open(folder / "log.npz", "rb") as file,
        np.load(file, allow_pickle=False) as data,
    ):
        log = dict(data)
    return log, json.loads((folder / "summary.json").read_text("utf-8"))
