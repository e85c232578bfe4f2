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
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Self
from urllib.request import ProxyHandler, build_opener

import matplotlib as mpl
import numpy as np
from pydrake.geometry import Meshcat

import nadia_balance.results.log as logs
from nadia_balance import palette
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.results import measurements
from nadia_balance.results.folder import appearing
from nadia_balance.results.log import Log, pushes, steps
from nadia_balance.results.plots import footsteps, time_series
from nadia_balance.results.story import command_words, tell_commands, telling
from nadia_balance.view.balance_visualizer import MIDDLE
from nadia_balance.view.scene import FRAMES_PER_SECOND

PLOTS = {
    "timeline.png": time_series.draw_contacts,
    "footsteps.png": footsteps.draw,
    "icp.png": time_series.draw_icp,
    "effort.png": time_series.draw_effort,
    "estimate.png": time_series.draw_estimate,
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
    folder: Path, log: Log, summary: dict, scenario: str, meshcat=None
) -> list[str]:
    """Writes the files of a run into `folder`; returns their names.

    `scenario` is YAML.  The recording of a `meshcat` becomes the replay.

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


def write_plots(folder: Path, log: Log, summary: dict) -> list[str]:
    """Draws every plot that the log has the data for; returns their names."""
    written = []
    with mpl.rc_context():
        mpl.rcdefaults()  # not the user's, such as text.usetex
        mpl.rcParams.update(time_series.RC)
        for name, draw in PLOTS.items() if len(log["t"]) > 1 else ():
            if (figure := draw(log, summary)) is not None:
                figure.savefig(folder / name)
                written.append(name)
    return written


def start_recording(meshcat: Meshcat, live: bool = False) -> None:
    """Starts the recording; if `live`, the scene is also shown meanwhile."""
    meshcat.DeleteRecording()
    meshcat.StartRecording(FRAMES_PER_SECOND, live)


def write_replay(meshcat: Meshcat, path: Path, status: str = "") -> None:
    """Ends the recording and writes it, with a legend, to `path`.

    The recording is also sent to browsers that show the scene.  `status` is
    HTML (see replay_status).
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page = _LONG.sub(_compressed, meshcat.StaticHtml())
    path.write_text(_extended(page, _legend(), status), encoding="utf-8")


def _extended(page: str, *additions: str) -> str:
    """Meshcat's `page`, which follows the robot, with HTML at its end."""
    page, end, rest = page.rpartition("</body>")
    return "".join([page, _FOLLOW % MIDDLE, *additions, end, rest])


def _compressed(command: re.Match) -> str:
    """The command with compressed data, which the browser inflates."""
    packed = gzip.compress(base64.b64decode(command[1]), mtime=0)
    return _INFLATE % base64.b64encode(packed).decode()


def _legend(colors: dict[str, str] = palette.LEGEND) -> str:
    """The legend of the `colors` as HTML; empty squares are outlines."""

    def square(color: str, outlined: bool) -> str:
        return f'<b style="color:{color}">&#{9632 + outlined};</b>'

    named, outlined = colors.items(), palette.OUTLINED
    entries = [f"{square(c, name in outlined)} {name}" for name, c in named]
    feet = "".join(square(palette.foot_color(side), True) for side in Side)
    entries.append(f"{feet} foothold as adjusted")
    return _LEGEND % "".join(f"<div>{entry}</div>" for entry in entries)


def replay_status(log: Log, summary: dict) -> str:
    """Returns the HTML of the status text of a replay.

    Each line of the story appears at its time, but for the commands, as the
    present one is told beside the mode; the last one, the result of the run, is
    shortened to its first part.  Buttons below jump to the begin of
    each push, step and command, below curves of ICP error, foot forces and
    torque.
    """
    color, commands = palette.foot_color, tell_commands(log)
    told = [line for line in telling(log, summary) if line not in commands]
    ends = "#1b7a3d" if summary["recovered"] else "#c01a2e"  # green, or red
    story = [[time, " ".join(text.split()), ""] for time, text in told[:-1]]
    story += [[t, text.split("   ")[0], ends] for t, text in told[-1:]]
    jumps = [[p.start, "push", palette.PUSH] for p in pushes(log)]
    jumps += [[time, text, palette.COMMAND] for time, text in commands]
    for s in steps(log):
        jumps.append([s.swing.start, f"step {s.number}", color(s.side)])
    names = "scenario", "robot", "plant", "mechanisms"
    said = {
        "title": "  ·  ".join(str(summary[n]) for n in names if n in summary),
        "phases": _moments(log),
        "story": story,
        "jumps": jumps,
        "curves": _curves(log),
        "end": float(log["t"][-1]),
    }
    return _STATUS + _REPLAY % json.dumps(said).replace("<", "\\u003c")


def _moments(log: Log) -> list[tuple[float, str]]:
    """Times, and what the status says from then on: mode, phase, command.

    Such as `recovering (left swing)`, or `standing`.
    """
    phases = []
    for span in logs.phase_spans(log):
        side = f"{span.swing_side.value} " * (span.phase is not Phase.STANDING)
        phases.append((span.start, f"{side}{span.phase.value}"))
    modes = [(span.start, span.mode.value) for span in logs.mode_spans(log)]
    commands = [
        (time, command_words(command))
        for time, command in logs.velocity_commands(log)
    ]
    tracks = modes, phases, commands
    texts = []
    for time in sorted({time for track in tracks for time, _ in track}):
        mode, phase, command = (
            next((text for t, text in reversed(track) if t <= time), "")
            for track in tracks
        )
        during = f" ({phase})" if phase != mode else ""
        moment = f"{mode}{during}" if mode else phase
        texts.append((time, ", ".join(filter(None, (moment, command)))))
    return texts


def _curves(log: Log) -> list[list]:
    """Strips: label, and curves [colour, values in % of the strip's largest].

    A value is the largest of its share of the run; a log may lack some strips.
    """
    edges = np.unique(np.linspace(0, len(log["t"]) - 1, _POINTS).astype(int))
    colors = [palette.foot_color(side) for side in Side]
    strips = []

    def add(values: np.ndarray, label: str, colors: list[str]) -> None:
        peaks = np.maximum.reduceat(np.atleast_2d(values), edges, 1)
        most = float(np.max(peaks))
        scaled = np.rint(100.0 * peaks / max(most, 1e-9)).astype(int)
        curves = zip(colors, scaled.tolist(), strict=True)
        strips.append([label.format(most), [*map(list, curves)]])

    if "icp_reference" in log:
        add(logs.icp_error(log), "ICP error, up to {:.2f} m", [palette.ICP])
    if "weight" in log:
        forces = (log["foot_forces"] / log["weight"]).T
        add(forces, "foot forces, up to {:.1f} of the weight", colors)
    if "effort_limits" in log:
        torque = np.max(measurements.torque_ratio(log), axis=1)
        label = "largest torque, up to {:.0%} of its limit"
        add(torque, label, [palette.SUPPORT])
    return strips


class LivePage(ThreadingHTTPServer):
    """Serves Meshcat's page, with lines of text and a legend, on localhost.

    Its panel is open.  As a context manager it serves within its block.
    """

    daemon_threads = True

    def __init__(self, meshcat: Meshcat):
        self._lines: list[str] = []
        self._meshcat_url = meshcat.web_url()
        self._fetch = build_opener(ProxyHandler({})).open
        page = self._fetched("/").decode()
        # The page still connects to Meshcat's websocket.
        page = page.replace("location.toString()", f'"{self._meshcat_url}/"')
        page = _TITLE.sub(_LIVE_TITLE, page)
        live = _LIVE % _POLLED
        legend = _legend(palette.LEGEND | palette.LIVE_LEGEND)
        self._page = _extended(page, legend, _STATUS, live).encode()
        super().__init__(("localhost", 0), _Handler)

    @property
    def url(self) -> str:
        """The URL of the page."""
        return f"http://localhost:{self.server_port}"

    def show(self, lines: list[str]) -> None:
        """Shows `lines` in the page."""
        self._lines = lines

    def __enter__(self) -> Self:
        threading.Thread(target=self.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()
        self.server_close()

    def _fetched(self, path: str) -> bytes:
        with self._fetch(f"{self._meshcat_url}/{path.lstrip('/')}") as answer:
            return answer.read()

    def answer(self, path: str) -> bytes:
        """What is at a path; OSError: Meshcat has no such file."""
        if path == _POLLED:
            return json.dumps(self._lines).encode()
        root = path.partition("?")[0] == "/"
        return self._page if root else self._fetched(path)


class _Handler(BaseHTTPRequestHandler):
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
