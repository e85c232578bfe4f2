"""The folder of a run: everything it leaves behind."""

import json
import os
import tempfile
from datetime import datetime
from pathlib import Path

import matplotlib as mpl
import numpy as np
from pydrake.geometry import Meshcat

from diagrams.plots import effort, footsteps, icp, timeline
from diagrams.plots.style import RC
from diagrams.replay import write_replay
from diagrams.run_log import Log

PLOTS = {
    "timeline.png": timeline.draw,
    "footsteps.png": footsteps.draw,
    "icp.png": icp.draw,
    "effort.png": effort.draw,
}


def prepare_folder(out: str | os.PathLike | None, name: str = "run") -> Path:
    """Makes the folder `out`, by default runs/<date>_<time>_<name>.

    Raises:
        ValueError: it cannot be made, or nothing can be written into it.
    """
    if out is None:
        now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        out = Path("runs") / f"{now}_{name}"
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Permissions alone do not tell: disks fill up, and root may write.
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"x")
            file.flush()
    except (OSError, ValueError) as error:
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
    """Writes all of a run into `folder`; returns the names of the files.

    `scenario` is the YAML of what was simulated.  With a `meshcat`, its
    recording becomes the replay.
    """
    np.savez(folder / "log.npz", **log)
    text = json.dumps(summary, indent=2, allow_nan=False)
    (folder / "summary.json").write_text(f"{text}\n", encoding="utf-8")
    (folder / "scenario.yaml").write_text(scenario, encoding="utf-8")
    written = ["log.npz", "summary.json", "scenario.yaml"]
    if meshcat is not None:
        write_replay(meshcat, folder / "replay.html")
        written.insert(0, "replay.html")
    return written + write_plots(folder, log, summary)


def write_plots(folder: Path, log: Log, summary: dict) -> list[str]:
    """Draws every plot that the log has the data for; returns their names."""
    written = []
    if len(log["t"]) < 2:
        return written
    with mpl.rc_context(RC):
        for name, draw in PLOTS.items():
            figure = draw(log, summary)
            if figure is not None:
                figure.savefig(folder / name)
                written.append(name)
    return written


def read_run(folder: Path) -> tuple[dict[str, np.ndarray], dict]:
    """Returns the log and the summary of a run."""
    # Opened here: numpy would leave open what is no whole archive.
    with (
        open(folder / "log.npz", "rb") as file,
        np.load(file, allow_pickle=False) as data,
    ):
        log = dict(data)
    return log, json.loads((folder / "summary.json").read_text("utf-8"))
