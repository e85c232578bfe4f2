"""What a run leaves: its files, the replay; and the page of a live session.

Meshcat cannot show text (Drake 1.58), so its pages are changed: a status text,
a legend, and a camera that follows the robot.
"""

import base64
import contextlib
import gzip
import json
import re
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Self
from urllib.request import ProxyHandler, build_opener

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from pydrake.geometry import Meshcat

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.results.folder import appearing
from nadia_balance.results.log import (
    Log,
    PhaseSpan,
    icp_error,
    mode_spans,
    phase_spans,
    pushes,
    steps,
    velocity_commands,
)
from nadia_balance.results.measurements import torque_ratio
from nadia_balance.results.plots import footsteps
from nadia_balance.results.plots.style import RC
from nadia_balance.results.plots.time_series import (
    draw_contacts,
    draw_effort,
    draw_estimate,
    draw_icp,
)
from nadia_balance.results.story import command_words, tell_commands, telling
from nadia_balance.view.balance_visualizer import MIDDLE
from nadia_balance.view.scene import FRAMES_PER_SECOND

PLOTS: dict[str, Callable[[Log, dict[str, Any]], Figure | None]] = {
    "timeline.png": draw_contacts,
    "footsteps.png": footsteps.draw,
    "icp.png": draw_icp,
    "effort.png": draw_effort,
    "estimate.png": draw_estimate,
}

# All files that a run may write.
FILES = ("replay.html", "log.npz", "summary.json", "scenario.yaml", *PLOTS)
_FOLLOW, _STATUS, _LEGEND, _REPLAY, _LIVE = (
    (Path(__file__).parent / f"{name}.html").read_text(encoding="utf-8")
    for name in ("follow", "status", "legend", "replay", "live")
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
_TITLE = re.compile("<title>.*?</title>")
_LIVE_TITLE = """<title>nadia_balance live</title>
  <meta name="viewport" content="width=device-width, initial-scale=1">"""
_POINTS = 500  # largest number of points of a curve
_POLLED = "/status"  # path of the live text, as a list of lines


def write_run(
    folder: Path,
    log: Log,
    summary: dict[str, Any],
    scenario: str,
    meshcat: Meshcat | None = None,
) -> list[str]:
    """Writes the files of a run.

    Args:
        folder: an existing folder, for the files.
        log: log of the run.
        summary: summary of the run.
        scenario: YAML text of the scenario.
        meshcat: where the run was recorded, if it was; for the replay.

    Returns:
        The names of the files.

    Raises:
        OSError: a file cannot be written; then none is.
    """
    with appearing(folder) as drafts:
        if meshcat is not None:
            write_replay(
                meshcat, drafts / "replay.html", replay_status(log, summary)
            )
        np.savez(drafts / "log.npz", **log)  # type: ignore[arg-type]
        (drafts / "summary.json").write_text(
            json.dumps(summary, indent=2, allow_nan=False) + "\n",
            encoding="utf-8",
        )
        (drafts / "scenario.yaml").write_text(scenario, encoding="utf-8")
        write_plots(drafts, log, summary)
    return [name for name in FILES if (folder / name).exists()]


def write_plots(folder: Path, log: Log, summary: dict[str, Any]) -> list[str]:
    """Draws every plot that the log has the data for.

    Args:
        folder: an existing folder, for the files.
        log: log of a run.
        summary: summary of the run.

    Returns:
        The names of the files; none for a log of a single row.
    """
    written = []
    with mpl.rc_context():
        mpl.rcdefaults()  # not the user's, such as text.usetex
        mpl.rcParams.update(RC)
        for name, draw in PLOTS.items() if len(log["t"]) > 1 else ():
            figure = draw(log, summary)
            if figure is not None:
                figure.savefig(folder / name)
                written.append(name)
    return written


def start_recording(meshcat: Meshcat, live: bool = False) -> None:
    """Starts a recording.

    Args:
        meshcat: scene to record; its last recording is deleted.
        live: whether the scene is also shown meanwhile.
    """
    meshcat.DeleteRecording()
    meshcat.StartRecording(FRAMES_PER_SECOND, live)


def write_replay(meshcat: Meshcat, path: Path, status: str = "") -> None:
    """Ends the recording and writes it, with a legend.

    The recording is also sent to browsers that show the scene.

    Args:
        meshcat: scene that is recorded.
        path: HTML file to write.
        status: HTML of the status text (see replay_status).
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page = _LONG.sub(_compressed, meshcat.StaticHtml())
    path.write_text(_extended(page, _legend(), status), encoding="utf-8")


def _extended(page: str, *additions: str) -> str:
    """Meshcat's `page`, which follows the robot, with HTML at its end."""
    page, end, rest = page.rpartition("</body>")
    return "".join([page, _FOLLOW % MIDDLE, *additions, end, rest])


def _compressed(command: re.Match[str]) -> str:
    """The command with compressed data, which the browser inflates."""
    packed = gzip.compress(base64.b64decode(command[1]), mtime=0)
    return _INFLATE % base64.b64encode(packed).decode()


def _legend(colors: dict[str, str] = palette.LEGEND) -> str:
    """The legend of the `colors` as HTML; empty squares are outlines."""
    feet = [_square(palette.foot_color(side), True) for side in Side]
    entries = [
        *(
            f"{_square(color, name in palette.OUTLINED)} {name}"
            for name, color in colors.items()
        ),
        f"{''.join(feet)} foothold as adjusted",
    ]
    return _LEGEND % "".join(f"<div>{entry}</div>" for entry in entries)


def _square(color: str, outlined: bool) -> str:
    return f'<b style="color:{color}">&#{9632 + outlined};</b>'


def replay_status(log: Log, summary: dict[str, Any]) -> str:
    """Returns the HTML of the status text of a replay.

    Each line of the story appears at its time, but for the commands, as the
    present one is told beside the mode; the last one, the result of the run, is
    shortened to its first part.  Buttons below jump to the begin of
    each push, step and command, below curves of ICP error, foot forces and
    torque.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        HTML for the end of the page.
    """
    data = json.dumps(
        {
            "title": "  ·  ".join(
                str(summary[name])
                for name in ("scenario", "robot", "plant", "mechanisms")
                if name in summary
            ),
            "phases": _moments(log),
            "story": _timed_story(log, summary),
            "jumps": _jumps(log),
            "curves": _curves(log),
            "end": float(log["t"][-1]),
        }
    )
    return _STATUS + _REPLAY % data.replace("<", "\\u003c")


def _timed_story(
    log: Log, summary: dict[str, Any]
) -> list[tuple[float, str, str]]:
    """Times, lines and colours of the story; a colour of "" is the usual."""
    commands = tell_commands(log)
    *lines, (end, result) = (
        line for line in telling(log, summary) if line not in commands
    )
    color = "#1b7a3d" if summary["recovered"] else "#c01a2e"  # green, or red
    return [
        *((time, " ".join(text.split()), "") for time, text in lines),
        (end, result.split("   ")[0], color),
    ]


def _jumps(log: Log) -> list[tuple[float, str, str]]:
    """Times, labels and colours of the buttons."""
    return [
        *((push.start, "push", palette.PUSH) for push in pushes(log)),
        *((time, text, palette.COMMAND) for time, text in tell_commands(log)),
        *(
            (
                step.swing.start,
                f"step {step.number}",
                palette.foot_color(step.side),
            )
            for step in steps(log)
        ),
    ]


def _moments(log: Log) -> list[tuple[float, str]]:
    """Times, and what the status says from then on: mode, phase, command.

    Such as `recovering (left swing)`, or `standing`.
    """
    modes = [(span.start, span.mode.value) for span in mode_spans(log)]
    phases = [(span.start, _phase_words(span)) for span in phase_spans(log)]
    commands = [
        (time, command_words(command))
        for time, command in velocity_commands(log)
    ]
    texts = []
    for time in sorted({time for time, _ in (*modes, *phases, *commands)}):
        moment, phase = _last(modes, time), _last(phases, time)
        if moment != phase:
            moment = f"{moment} ({phase})" if moment else phase
        words = filter(None, (moment, _last(commands, time)))
        texts.append((time, ", ".join(words)))
    return texts


def _phase_words(span: PhaseSpan) -> str:
    if span.phase is Phase.STANDING:
        return str(span.phase.value)
    return f"{span.swing_side.value} {span.phase.value}"


def _last(texts: list[tuple[float, str]], time: float) -> str:
    """The last one of timed texts that is not later than `time` [s]."""
    return next((text for t, text in reversed(texts) if t <= time), "")


# A label, and its curves: colour, and values in % of the strip's largest.
_Strip = tuple[str, list[tuple[str, list[int]]]]


def _curves(log: Log) -> list[_Strip]:
    """The strips that the log has the data for."""
    strips = []
    if "icp_reference" in log:
        strips.append(
            _strip(icp_error(log), "ICP error, up to {:.2f} m", [palette.ICP])
        )
    if "weight" in log:
        strips.append(
            _strip(
                (log["foot_forces"] / log["weight"]).T,
                label="foot forces, up to {:.1f} of the weight",
                colors=[palette.LEFT, palette.RIGHT],
            )
        )
    if "effort_limits" in log:
        strips.append(
            _strip(
                np.max(torque_ratio(log), axis=1),
                label="largest torque, up to {:.0%} of its limit",
                colors=[palette.SUPPORT],
            )
        )
    return strips


def _strip(values: Array, label: str, colors: list[str]) -> _Strip:
    """A strip of `values` (..., n); a point is the largest of its share."""
    edges = np.linspace(0, values.shape[-1] - 1, _POINTS).astype(int)
    peaks = np.maximum.reduceat(np.atleast_2d(values), np.unique(edges), 1)
    largest = float(np.max(peaks))
    scaled = np.rint(100.0 * peaks / max(largest, 1e-9)).astype(int)
    return label.format(largest), [*zip(colors, scaled.tolist(), strict=True)]


class LivePage(ThreadingHTTPServer):
    """Serves Meshcat's page, with lines of text and a legend, on localhost.

    Its panel is open.  As a context manager it serves within its block.
    """

    daemon_threads = True

    def __init__(self, meshcat: Meshcat):
        """Fetches Meshcat's page, and opens a port.

        Args:
            meshcat: scene to show.
        """
        self._lines: list[str] = []
        self._meshcat_url = meshcat.web_url()
        self._fetch = build_opener(ProxyHandler({})).open
        page = _TITLE.sub(_LIVE_TITLE, self._fetched("/").decode())
        # The page still connects to Meshcat's websocket.
        page = page.replace("location.toString()", f'"{self._meshcat_url}/"')
        self._page = _extended(
            page,
            _legend(palette.LEGEND | palette.LIVE_LEGEND),
            _STATUS,
            _LIVE % _POLLED,
        ).encode()
        super().__init__(("localhost", 0), _Handler)

    @property
    def url(self) -> str:
        """The URL of the page."""
        return f"http://localhost:{self.server_port}"

    def show(self, lines: list[str]) -> None:
        """Shows a text in the page.

        Args:
            lines: its lines.
        """
        self._lines = lines

    def __enter__(self) -> Self:
        threading.Thread(target=self.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()
        self.server_close()

    def _fetched(self, path: str) -> bytes:
        with self._fetch(f"{self._meshcat_url}/{path.lstrip('/')}") as answer:
            return bytes(answer.read())

    def answer(self, path: str) -> bytes:
        """Returns what is at a path: the page, the text, a file of Meshcat's.

        Args:
            path: path of a request.

        Returns:
            The body.

        Raises:
            OSError: Meshcat has no such file.
        """
        if path == _POLLED:
            return json.dumps(self._lines).encode()
        if path.partition("?")[0] == "/":
            return self._page
        return self._fetched(path)


class _Handler(BaseHTTPRequestHandler):
    server: LivePage

    def do_GET(self) -> None:
        try:
            code, body = 200, self.server.answer(self.path)
        except OSError:
            code, body = 404, b""
        with contextlib.suppress(OSError):  # the browser is gone
            self.send_response(code)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Suppresses the log of requests on the terminal."""
