"""Meshcat's page with a status text that is updated while the robot walks."""

import contextlib
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self
from urllib.request import ProxyHandler, build_opener

from pydrake.geometry import Meshcat

from nadia_balance.results.folder import FOLLOW
from nadia_balance.systems.balance_visualizer import MIDDLE

STATUS = "/status"
# The controls come before the folders of the scene.  Meshcat's own statistics
# are hidden: the status text contains the real-time factor.
_TEXT = """
<style>
.dg.main > ul { display: flex; flex-direction: column; }
.dg.main > ul > li.folder { order: 1; }
#stats-plot { display: none !important; }
</style>
<div id="status" style="position:fixed; left:14px; top:12px; max-width:46%%;
padding:8px 12px; border-radius:8px; background:#ffffffc8; color:#2f3440;
font:14px/1.5 sans-serif; pointer-events:none"></div>
<script>
viewer.gui.open();
viewer.gui.__folders.Scene.close();
(async () => {
  const box = document.getElementById("status");
  for (;;) {
    try {
      const lines = await (await fetch("%s")).json();
      box.replaceChildren(...lines.map((text) => {
        const line = document.createElement("div");
        line.textContent = text;
        return line;
      }));
    } catch {
      box.textContent = "The program has ended.";
    }
    await new Promise((done) => setTimeout(done, 150));
  }
})();
</script>
"""


class LivePage:
    """Serves Meshcat's page, with lines of text added, on localhost.

    Meshcat cannot show text (Drake 1.58), so its page is changed: a status
    text, an opened panel, and a camera that follows the robot.  As a context
    manager it serves within its block.
    """

    def __init__(self, meshcat: Meshcat):
        """Serves from a free port; see `url`."""
        self._lines: list[str] = []
        self._meshcat_url = meshcat.web_url()
        self._fetch = build_opener(ProxyHandler({})).open
        page = self._fetched("/").decode()
        # The page still connects to Meshcat's websocket.
        page = page.replace("location.toString()", f'"{self._meshcat_url}/"')
        page, end, rest = page.rpartition("</body>")
        text = FOLLOW % MIDDLE + _TEXT % STATUS
        self._page = (page + text + end + rest).encode()
        self._server = ThreadingHTTPServer(("localhost", 0), self._handler())
        self._server.daemon_threads = True

    @property
    def url(self) -> str:
        """The URL of the page."""
        return f"http://localhost:{self._server.server_address[1]}"

    def show(self, lines: list[str]) -> None:
        """Shows `lines` in the page."""
        self._lines = lines

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()

    def _fetched(self, path: str) -> bytes:
        url = f"{self._meshcat_url}/{path.lstrip('/')}"
        with self._fetch(url) as answer:
            return answer.read()

    def _answer(self, path: str) -> bytes:
        if path == STATUS:
            return json.dumps(self._lines).encode()
        if path.partition("?")[0] == "/":
            return self._page
        return self._fetched(path)

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        page = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                try:
                    code, body = 200, page._answer(self.path)
                except OSError:  # Meshcat has no such file
                    code, body = 404, b""
                with contextlib.suppress(OSError):  # the browser is gone
                    self.send_response(code)
                    self.send_header("Content-Length", str(len(body)))
                    self.end_headers()
                    self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                """Suppresses the log of requests on the terminal."""

        return Handler
