"""The folder of a run: its log, summary, scenario, replay and plots."""

import base64
import contextlib
import gzip
import json
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

import matplotlib as mpl
import numpy as np
from pydrake.geometry import Meshcat

from nadia_balance import palette
from nadia_balance.core.walking import Side
from nadia_balance.results.log import Log
from nadia_balance.results.plots import effort, footsteps, icp, timeline
from nadia_balance.results.plots.style import RC
from nadia_balance.results.replay_page import replay_status
from nadia_balance.results.scene import FRAMES_PER_SECOND
from nadia_balance.systems.balance_visualizer import MIDDLE

PLOTS = {
    "timeline.png": timeline.draw,
    "footsteps.png": footsteps.draw,
    "icp.png": icp.draw,
    "effort.png": effort.draw,
}

# All files that a run may write.
FILES = ("replay.html", "log.npz", "summary.json", "scenario.yaml", *PLOTS)

_LEGEND = (
    '<div id="legend" style="position:fixed; left:14px; bottom:12px; '
    "padding:8px 12px; border-radius:8px; background:#ffffffc8; "
    "font:13px/1.45 sans-serif; color:#2f3440; "
    'pointer-events:none">%s</div>'
)
# A long command to the viewer; the only one of a replay is its animation.
_LONG = re.compile(
    r'fetch\("data:application/octet-binary;base64,([^"]{100000,})"\)'
    r"\s*\.then\(res => "
)
_INFLATE = """fetch("data:application/gzip;base64,%s")
    .then(res => new Response(
        res.body.pipeThrough(new DecompressionStream("gzip"))))
    .then(res => """
# Moves camera and target with the robot when it leaves a band about its last
# position.  The user can still rotate and zoom.
FOLLOW = """
<script>
(() => {
  const path = "%s".split("/").filter((name) => name);
  const node = viewer.scene_tree.find(path);
  const band = 0.15;
  let last = null;
  viewer.follow = () => {
    const p = node.object.position;
    last = last || [p.x, p.y];
    const move = [p.x - last[0], p.y - last[1]].map(
        (d) => Math.sign(d) * Math.max(Math.abs(d) - band, 0));
    last = [last[0] + move[0], last[1] + move[1]];
    // The camera's axes are y up: its z is our -y.
    for (const v of [viewer.camera.position, viewer.controls.target]) {
      v.x += move[0];
      v.z -= move[1];
    }
  };
  viewer.set_render_callback("() => viewer.follow()");
})();
</script>
"""


def new_folder(
    out: str | os.PathLike | None, name: str = "run", files: Sequence = FILES
) -> Path:
    """Creates the folder `out` (see prepare_folder) for new `files`.

    Raises:
        ValueError: one of the files exists, or as prepare_folder.
    """
    for file in files if out is not None else ():
        if (Path(out) / file).exists():
            raise ValueError(
                f"out = {str(out)!r}: must be a folder without {file}"
            )
    return prepare_folder(out, name)


def prepare_folder(out: str | os.PathLike | None, name: str = "run") -> Path:
    """Creates the folder `out`, by default runs/<date>_<time>_<name>.

    Raises:
        ValueError: it cannot be created, or is not writable.
    """
    if out is None:
        now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        out = Path("runs") / f"{now}_{name}"
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # A test write also detects a full disk, unlike permissions.
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"x")
            file.flush()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise ValueError(
            f"out = {str(folder)!r}: must be a folder to write to ({why})"
        ) from error
    return folder


def start_recording(meshcat: Meshcat, live: bool = False) -> None:
    """Starts the recording; if `live`, the scene is also shown meanwhile."""
    meshcat.DeleteRecording()
    meshcat.StartRecording(
        frames_per_second=FRAMES_PER_SECOND,
        set_visualizations_while_recording=live,
    )


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

    Raises:
        OSError: a file cannot be written; then none is.
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

    Raises:
        OSError: a file cannot be written; then none appears in `folder`.
    """
    with tempfile.TemporaryDirectory(prefix=".", dir=folder) as place:
        drafts = Path(place)
        yield drafts
        for draft in sorted(drafts.iterdir()):
            draft.replace(folder / draft.name)


def write_replay(meshcat: Meshcat, path: Path, status: str = "") -> None:
    """Ends the recording and writes it, with a legend, to `path`.

    The recording is also sent to browsers that show the scene.  `status` is
    HTML (see replay_status).
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page = _LONG.sub(_compressed, meshcat.StaticHtml())
    page, end, rest = page.rpartition("</body>")
    additions = _LEGEND % legend_entries("div") + FOLLOW % MIDDLE
    additions += status
    path.write_text(page + additions + end + rest, encoding="utf-8")


def _compressed(command: re.Match) -> str:
    """The command with compressed data, which the browser inflates."""
    packed = gzip.compress(base64.b64decode(command[1]), mtime=0)
    return _INFLATE % base64.b64encode(packed).decode()


def legend_entries(tag: str) -> str:
    """The legend of the colours as HTML, each entry in a `tag`.

    Full squares are filled shapes, empty squares outlines.
    """

    def square(color: str, outlined: bool) -> str:
        return f'<b style="color:{color}">&#{9632 + outlined};</b>'

    entries = [
        f"{square(color, name in palette.OUTLINED)} {name}"
        for name, color in palette.LEGEND.items()
    ]
    feet = "".join(square(palette.foot_color(side), True) for side in Side)
    entries.append(f"{feet} foothold as adjusted")
    return "".join(f"<{tag}>{entry}</{tag}>" for entry in entries)


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
    # Opened here, because numpy does not close a corrupt archive.
    with (
        open(folder / "log.npz", "rb") as file,
        np.load(file, allow_pickle=False) as data,
    ):
        log = dict(data)
    return log, json.loads((folder / "summary.json").read_text("utf-8"))
