"""Takes pictures of a run's replay and puts them side by side.

The default pictures show the end of the push, and each of the next two steps
just before it lands; --gif writes an animation of the push and the next 2.5 s.

Examples:
    python scripts/picture.py --run runs/my_run
    python scripts/picture.py --run runs/my_run --times 3.5 3.9 --out two.png
    python scripts/picture.py --run runs/my_run --gif --width 320
"""

from __future__ import annotations

import nadia_balance.scripts  # noqa: F401  (first, for Ctrl-C)

# isort: split
import argparse
import base64
import html
import io
import shutil
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from PIL import Image

from nadia_balance.core.bounds import bounded, check
from nadia_balance.results.folder import appearing, read_run
from nadia_balance.results.log import pushes, steps
from nadia_balance.results.pages import legend_entries
from nadia_balance.scripts.command_line import (
    DONE,
    CommandLine,
    finite,
    place,
    program,
    say,
)
from nadia_balance.systems.balance_visualizer import MIDDLE, REGIONS_PERIOD

try:
    from playwright import sync_api
except ImportError:  # optional; write_strip reports that it is missing
    sync_api = None

_MISSING = "playwright is missing: pip install playwright"
_FLAGS = (
    "--no-sandbox",  # root has no sandbox
    "--enable-unsafe-swiftshader",  # WebGL without a GPU
)
_SHARPNESS = 2  # pixels of a picture for each pixel of the strip
_NUM_STEPS = 2  # pictures of steps after the push
_BEFORE = 0.03  # time from a picture to its landing [s]
_GIF = 0.4, 2.5  # time before the push begins, and after its end [s]
_GIF_PERIOD = 2.0 * REGIONS_PERIOD  # frame period [s]

# Points the camera at the robot; hides everything except the scene.
_LOOK = """
({time, path, azimuth_deg, elevation_deg, distance, height}) => {
  for (const node of document.querySelectorAll("#legend, #status, .dg")) {
    node.style.display = "none";
  }
  viewer.set_render_callback("() => {}");  // no longer follows by itself
  viewer.animator.pause();
  viewer.animator.seek(time);
  const names = path.split("/").filter((name) => name);
  const middle = viewer.scene_tree.find(names).object.position;
  const [azimuth, elevation] = [azimuth_deg, elevation_deg].map(
      (angle) => angle * Math.PI / 180);
  const away = distance * Math.cos(elevation);
  const x = middle.x + away * Math.cos(azimuth);
  const y = middle.y + away * Math.sin(azimuth);
  const z = height + distance * Math.sin(elevation);
  // The camera's axes are y up: its z is our -y.
  viewer.controls.target.set(middle.x, height, -middle.y);
  viewer.camera.position.set(x, z, -y);
  viewer.controls.update();
  viewer.render();  // moves the camera, ...
  viewer.render();  // ... and draws what it sees
}
"""

_STRIP = """
<style>
  body {{ margin: 0; background: white; color: #2f3440;
         font: 21px/1.3 "DejaVu Sans", sans-serif; }}
  #strip {{ display: inline-block; }}
  .row {{ display: flex; gap: 8px; }}
  figure {{ margin: 0; position: relative; }}
  img {{ display: block; width: {width}px; height: {height}px;
        border-radius: 8px; }}
  figcaption {{ position: absolute; left: 16px; top: 12px; }}
  .legend {{ display: flex; flex-wrap: wrap; justify-content: center;
            gap: 3px 20px; padding: 10px 12% 6px; font-size: 17px;
            width: 0; min-width: 100%; box-sizing: border-box; }}
</style>
<div id="strip"><div class="row">{figures}</div>
<div class="legend">{legend}</div></div>
"""


@program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv` and returns 0; bad input exits."""
    parser = CommandLine(
        prog="picture.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Exit code: 0 written, 2 bad input, 130 Ctrl-C.",
    )
    parser.add_argument(
        "--run", type=place, required=True, help="folder with its replay.html"
    )
    parser.add_argument("--times", type=finite, nargs="+", help="[s]")
    parser.add_argument("--captions", nargs="+", help="one for each time")
    parser.add_argument(
        "--out", type=place, help="PNG; by default picture.png in the folder"
    )
    parser.add_argument(
        "--gif", action="store_true", help="moving, picture.gif by default"
    )
    group = parser.add_argument_group("view")
    for flag, field, kind, meaning in (
        ("azimuth", "azimuth_deg", finite, "0 from in front, 90 left [deg]"),
        ("elevation", "elevation_deg", finite, "above the horizon [deg]"),
        ("distance", "distance", finite, "of the camera [m]"),
        ("width", "width_px", int, "of each picture [pixels]"),
        ("height", "height_px", int, "of each picture [pixels]"),
    ):
        default = getattr(View, field)
        group.add_argument(
            f"--{flag}", dest=field, type=kind, default=default, help=meaning
        )
    args = parser.parse_args(argv)
    with parser.refusing():
        out = _write(args)
    say(f"wrote {out}")
    return DONE


def _write(args: argparse.Namespace) -> Path:
    view = View(
        azimuth_deg=args.azimuth_deg,
        elevation_deg=args.elevation_deg,
        distance=args.distance,
        width_px=args.width_px,
        height_px=args.height_px,
    )
    replay = args.run / "replay.html"
    if not replay.is_file():
        raise ValueError(
            f"run = {str(args.run)!r}: must be a folder with a replay.html"
        )
    if args.gif:
        out = args.out or args.run / "picture.gif"
        if out.suffix != ".gif":
            raise ValueError(f"out = {str(out)!r}: must end in .gif")
        write_gif(replay, args.times or gif_times(args.run), view, out)
        return out
    times = args.times or moments(args.run)
    captions = args.captions or [f"{time:.2f} s" for time in times]
    if len(captions) != len(times):
        raise ValueError(
            f"captions = {len(captions)}: must be as many as times, "
            f"{len(times)}"
        )
    out = args.out or args.run / "picture.png"
    if out.suffix != ".png":
        raise ValueError(f"out = {str(out)!r}: must end in .png")
    write_strip(replay, times, captions, view, out)
    return out


def moments(run: Path) -> list[float]:
    """Times [s] of the end of the last push, and just before the next landings.

    Raises:
        ValueError: the `run` has no push, or its log is not complete.
        OSError: the log does not exist.
    """
    _, end, landings = _pushed_and_landed(run)
    return [end, *(t - _BEFORE for t in landings[:_NUM_STEPS])]


def gif_times(run: Path) -> list[float]:
    """Times [s] of the frames around the last push; raises as `moments`."""
    start, end, _ = _pushed_and_landed(run)
    first = max(start - _GIF[0], 0.0)
    # The replay's last frame may be before the log's last row.
    whole = float(read_run(run)[0]["t"][-1]) - REGIONS_PERIOD
    last = min(end + _GIF[1], whole)
    return np.arange(first, last, _GIF_PERIOD).tolist()


def _pushed_and_landed(run: Path) -> tuple[float, float, list[float]]:
    """Start and end of the last push, and the landings after it [s]."""
    try:
        log, _ = read_run(run)
        pushed, landed = pushes(log), steps(log)
    except (BadZipFile, EOFError, KeyError, ValueError) as error:
        raise ValueError(
            f"run = {str(run)!r}: must have a whole log.npz and summary.json, "
            f"as --times are not given ({error!r})"
        ) from error
    if not pushed:
        raise ValueError("times: must be given, without a push")
    end = pushed[-1].end
    landings = [step.swing.end for step in landed if step.swing.end > end]
    return pushed[-1].start, end, landings


@dataclass(kw_only=True)
class View:
    """The camera's direction and distance, and the size of a picture."""

    azimuth_deg: float = 14.0  # 0 from in front, 90 from its left [deg]
    elevation_deg: float = bounded(14.0, least=0.0, most=89.0)  # [deg]
    distance: float = bounded(3.7, least=0.5, most=50.0)  # of the camera [m]
    height: float = bounded(0.74, least=0.0, most=3.0)  # of the target [m]
    width_px: int = bounded(440, least=50, most=4000)
    height_px: int = bounded(620, least=50, most=4000)


def launch_chromium(playwright: sync_api.Playwright) -> sync_api.Browser:
    """Returns a headless Chromium: the system's, else playwright's own.

    Raises:
        ValueError: Chromium is missing or does not start.
    """
    found = shutil.which("chromium") or shutil.which("google-chrome")
    try:
        return playwright.chromium.launch(executable_path=found, args=_FLAGS)
    except sync_api.Error as error:
        raise ValueError(
            "Chromium is missing or does not start: apt-get install "
            "chromium, or playwright install chromium"
        ) from error


def write_strip(
    replay: Path, times: list[float], captions: list[str], view: View, out: Path
) -> None:
    """Writes pictures of `replay` at `times` [s], side by side, to `out` (PNG).

    Raises:
        ValueError: `replay` is incomplete, or no replay; a time is not within
            it; or playwright or Chromium is missing.
    """
    if sync_api is None:
        raise ValueError(_MISSING)
    check(view)
    with sync_api.sync_playwright() as playwright:
        browser = launch_chromium(playwright)
        pictures = _pictures(browser, replay, times, view)
        page = browser.new_page(device_scale_factor=1)
        page.set_viewport_size(
            {"width": len(times) * (view.width_px + 8), "height": 100}
        )
        page.set_content(_strip(pictures, captions, view))
        strip = page.locator("#strip").screenshot()
        browser.close()
    with appearing(out.parent) as drafts:
        (drafts / out.name).write_bytes(strip)


def write_gif(replay: Path, times: list[float], view: View, out: Path) -> None:
    """Writes `replay` at `times` [s] as an animation to `out`.

    It loops, in real time if the times are as far apart as `gif_times`.

    Raises:
        ValueError: as `write_strip`.
    """
    if sync_api is None:
        raise ValueError(_MISSING)
    check(view)
    with sync_api.sync_playwright() as playwright:
        browser = launch_chromium(playwright)
        pictures = _pictures(browser, replay, times, view, sharpness=1)
        browser.close()
    first, *others = (
        Image.open(io.BytesIO(picture))
        .convert("RGB")
        .quantize(method=Image.Quantize.MAXCOVERAGE)  # keeps rare colours
        for picture in pictures
    )
    first.save(
        out,
        save_all=True,
        append_images=others,
        duration=round(1000 * _GIF_PERIOD),
        loop=0,
    )


def _pictures(
    browser: sync_api.Browser,
    replay: Path,
    times: list[float],
    view: View,
    sharpness: int = _SHARPNESS,
) -> list[bytes]:
    """Returns a PNG for each of the `times` [s]."""
    page = browser.new_page(
        viewport={"width": view.width_px, "height": view.height_px},
        device_scale_factor=sharpness,
        offline=True,
    )
    duration = _open(page, replay)
    for time in times:
        if not 0.0 <= time <= duration:
            raise ValueError(
                f"times = {time}: must be within the replay, "
                f"[0, {duration:.2f}] s"
            )
    pictures = []
    for time in times:
        # The nearest time at which all objects were drawn: in between, a replay
        # interpolates between two shapes of a polygon.
        frame = round(time / REGIONS_PERIOD) * REGIONS_PERIOD
        page.evaluate(_LOOK, {"time": frame, "path": MIDDLE, **asdict(view)})
        pictures.append(page.screenshot())
    return pictures


def _open(page: sync_api.Page, replay: Path) -> float:
    """Loads `replay` into the `page`; returns its duration [s]."""
    try:
        page.goto(replay.resolve().as_uri())
        page.wait_for_function("viewer.animator.duration > 0")
        return page.evaluate("viewer.animator.duration")
    except sync_api.Error as error:  # a TimeoutError, too
        raise ValueError(
            f"run = {str(replay.parent)!r}: must have a whole {replay.name} "
            f"({error.message.splitlines()[0]})"
        ) from error


def _strip(pictures: list[bytes], captions: list[str], view: View) -> str:
    """The page with all pictures and the legend of colours."""
    figures = "".join(
        '<figure><img src="data:image/png;base64,'
        f'{base64.b64encode(picture).decode()}">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
        for picture, caption in zip(pictures, captions, strict=True)
    )
    return _STRIP.format(
        width=view.width_px,
        height=view.height_px,
        figures=figures,
        legend=legend_entries("span"),
    )


if __name__ == "__main__":
    sys.exit(main())
