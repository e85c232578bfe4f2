"""What a run leaves: its files, the replay; and the page of a live session.

Meshcat cannot show text (Drake 1.58), so its pages are changed: words and a
legend beside the scene, and a camera that follows the robot.
"""

import base64
import contextlib
import gzip
import html
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
from nadia_balance.core.walking.state import Side
from nadia_balance.results.film import film
from nadia_balance.results.folder import appearing
from nadia_balance.results.log import Log
from nadia_balance.results.plots import footsteps
from nadia_balance.results.plots.style import RC
from nadia_balance.results.plots.time_series import (
    draw_contacts,
    draw_effort,
    draw_estimate,
    draw_icp,
)
from nadia_balance.view.balance_visualizer import MIDDLE
from nadia_balance.view.scene import FRAMES_PER_SECOND, NIGHT

PLOTS: dict[str, Callable[[Log, dict[str, Any]], Figure | None]] = {
    "timeline.png": draw_contacts,
    "footsteps.png": footsteps.draw,
    "icp.png": draw_icp,
    "effort.png": draw_effort,
    "estimate.png": draw_estimate,
}

# All files that a run may write.
CONTRACT = "policy.yaml"  # of a policy
FILES = (
    "replay.html",
    "log.npz",
    "summary.json",
    "scenario.yaml",
    CONTRACT,
    *PLOTS,
)
_PAGE, _REPLAY, _LIVE = (
    (Path(__file__).parent / f"{name}.html").read_text(encoding="utf-8")
    for name in ("page", "replay", "live")
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
_HEAD = """<title>%s</title>
  <meta name="viewport" content="width=device-width, initial-scale=1">"""
_POLLED = "/status"  # path of the live text, as a list of lines


def write_run(
    folder: Path,
    log: Log,
    summary: dict[str, Any],
    scenario: str,
    meshcat: Meshcat | None = None,
    contract: str = "",
) -> list[str]:
    """Writes the files of a run.

    Args:
        folder: an existing folder, for the files.
        log: log of the run.
        summary: summary of the run.
        scenario: YAML text of the scenario.
        meshcat: where the run was recorded, if it was; for the replay.
        contract: YAML text of that of a policy, if one walked.

    Returns:
        The names of the files.

    Raises:
        OSError: a file cannot be written; then none is.
    """
    with appearing(folder) as drafts:
        if meshcat is not None:
            write_replay(meshcat, drafts / "replay.html", film(log, summary))
        np.savez(drafts / "log.npz", **log)  # type: ignore[arg-type]
        (drafts / "summary.json").write_text(
            json.dumps(summary, indent=2, allow_nan=False) + "\n",
            encoding="utf-8",
        )
        (drafts / "scenario.yaml").write_text(scenario, encoding="utf-8")
        if contract:
            (drafts / CONTRACT).write_text(contract, encoding="utf-8")
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


def write_replay(
    meshcat: Meshcat, path: Path, shown: dict[str, Any] | None = None
) -> None:
    """Ends the recording and writes it, with a legend.

    The recording is also sent to browsers that show the scene.

    Args:
        meshcat: scene that is recorded.
        path: HTML file to write.
        shown: what is beside the scene (see `film`).
    """
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page = _LONG.sub(_compressed, meshcat.StaticHtml())
    page = _extended(
        page,
        str((shown or {}).get("title", "")),
        palette.LEGEND,
        *([_filled(_REPLAY, shown)] if shown else []),
    )
    path.write_text(page, encoding="utf-8")


def _extended(
    page: str, title: str, legend: dict[str, palette.Entry], *additions: str
) -> str:
    """Meshcat's `page` with words and a legend beside the scene."""
    data = {
        "title": title,
        "legend": [
            *((name, [[*entry]]) for name, entry in legend.items()),
            (
                "foothold as adjusted",
                [[palette.OUTLINE, palette.foot_color(side)] for side in Side],
            ),
        ],
        "middle": MIDDLE,
        "colors": NIGHT,
    }
    page = _TITLE.sub(lambda _: _HEAD % html.escape(title), page)
    page, end, rest = page.rpartition("</body>")
    return "".join([page, _filled(_PAGE, data), *additions, end, rest])


def _filled(template: str, data: Any) -> str:
    """HTML with data; a text in it cannot end its script."""
    return template.replace(
        "{{data}}", json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    )


def _compressed(command: re.Match[str]) -> str:
    """The command with compressed data, which the browser inflates."""
    packed = gzip.compress(base64.b64decode(command[1]), mtime=0)
    return _INFLATE % base64.b64encode(packed).decode()


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
        page = self._fetched("/").decode()
        # The page still connects to Meshcat's websocket.
        page = page.replace("location.toString()", f'"{self._meshcat_url}/"')
        self._page = _extended(
            page,
            "nadia_balance live",
            palette.LEGEND | palette.LIVE_LEGEND,
            _filled(_LIVE, _POLLED),
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
