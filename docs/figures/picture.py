"""Takes pictures of a run's replay, side by side or as an animation.

By default they show the end of the last push, and each of the next two steps
just before it lands; the animation shows the push and the next 2.4 s at half
speed, with what the replay says of them, and holds its end.  The camera is at
--azimuth (0 in front of the robot, 90 to its left) and --elevation [deg],
--distance [m] away; a picture has --width by --height pixels.

Examples:
    python docs/figures/picture.py --run runs/my_run
    python docs/figures/picture.py --run runs/my_run --times 3.5 3.9 --out a.png
    python docs/figures/picture.py --run runs/my_run --gif --width 640
"""

import argparse
import io
import math
import shutil
import sys
from dataclasses import fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from PIL import Image
from playwright import sync_api

from nadia_balance.palette import LEGEND
from nadia_balance.parameters.bounds import bounded, check, parameters
from nadia_balance.results.folder import appearing
from nadia_balance.results.log import pushes, steps
from nadia_balance.results.versions import other_version
from nadia_balance.scripts import command_line
from nadia_balance.view.balance_visualizer import MIDDLE, REGIONS_PERIOD

_FLAGS = (
    "--no-sandbox",  # root has no sandbox
    "--enable-unsafe-swiftshader",  # WebGL without a GPU
)
_PATIENCE = 180_000  # without a GPU, on a busy machine [ms]
_TARGET = 0.74  # height at which the camera looks [m]
_GAP = 8  # between the pictures of a strip [pixels]
_SHARPNESS = 2  # pixels of the browser for each pixel of a picture
_NUM_STEPS = 2  # pictures of steps after the push
_BEFORE = 0.03  # time from a picture to its landing [s]
_GIF = 0.4, 2.4  # time before the push begins, and after its end [s]
_SLOWER = 2.0  # than real time is an animation [-]
_HOLD = 3.0  # for which it shows its last frame [s]

# Points the camera at the robot, and sets the caption.
_LOOK = """
({time, caption, aims, path, height, offset: [dx, dy, dz]}) => {
  document.body.dataset.caption = caption;
  viewer.set_render_callback("() => {}");  // no longer follows by itself
  viewer.animator.pause();
  viewer.film?.play(false);
  (viewer.film ?? viewer.animator).seek(time);
  if (aims) {
    const p = viewer.scene_tree.find(path).object.position;
    // The camera's axes are y up: its z is our -y.
    viewer.controls.target.set(p.x, height, -p.y);
    viewer.camera.position.set(p.x + dx, height + dz, -p.y - dy);
    viewer.controls.update();
  }
  viewer.render();  // moves the camera, ...
  viewer.render();  // ... and draws what it sees
}
"""
# What a picture, and a frame, show of the replay's page beside the scene: a
# picture its caption; a frame the last two lines, and what is drawn.
_CAPTION = """
  #words, #film, #legend, .dg { display: none !important; }
  body { grid-template: "pane" 100vh / 100% !important; }
  body::after { content: attr(data-caption); position: fixed; left: 16px;
                top: 12px; z-index: 2; color: #2f3440;
                font: 21px/1.3 "DejaVu Sans", sans-serif; }
"""
_WORDS = """
  #words { display: contents !important; }
  #title, #film, details, .dg { display: none !important; }
  body { height: 100vh !important;
         grid-template: "said" 68px "pane" 1fr "legend" auto / 100% !important;
         font: 14px/1.4 "DejaVu Sans", sans-serif !important; }
  body::after { content: "at half speed"; position: fixed; right: 10px;
                top: 74px; z-index: 2; color: #626b78; }
  #status { grid-area: said; padding: 8px 12px; }
  #status > :not(:nth-last-child(-n+2)) { display: none; }
  #legend { grid-area: legend; display: flex; flex-wrap: wrap; gap: 0 14px;
            justify-content: center; margin: 0 !important; padding: 4px 8px; }
"""
# What the strip shows below its pictures.
_LEGEND = """
  body > :not(#legend) { visibility: hidden; }
  body::after { content: none !important; }
  #legend { position: fixed !important; inset: 0 0 auto 0 !important;
            display: flex !important; flex-wrap: wrap; justify-content: center;
            gap: 3px 20px; padding: 10px 12% 6px !important; margin: 0;
            background: white !important;
            font: 17px/1.3 "DejaVu Sans", sans-serif !important; }
"""


@parameters
class View:
    """The camera's direction and distance, and the size of a picture."""

    azimuth: float = bounded(
        14.0, doc="degrees from in front of the robot, 90 is its left"
    )
    elevation: float = bounded(
        14.0, doc="degrees above the horizon", least=0.0, most=89.0
    )
    distance: float = bounded(
        3.7, doc="metres from the robot", least=0.5, most=50.0
    )
    width: int = bounded(440, doc="pixels of a picture", least=50, most=4000)
    height: int = bounded(620, doc="pixels of a picture", least=50, most=4000)


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Takes the pictures; bad input exits.

    Args:
        argv: command line; by default the program's.

    Returns:
        The exit code 0.
    """
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 written, 2 bad input, 130 Ctrl-C.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--run", type=command_line.place, required=True, help="its folder"
    )
    parser.add_argument(
        "--times", type=command_line.finite, nargs="+", help="[s]"
    )
    parser.add_argument("--gif", action="store_true", help="an animation")
    parser.add_argument(
        "--out",
        type=command_line.place,
        help="by default picture.png or .gif in the folder",
    )
    for field in fields(View):
        parser.add_argument(
            f"--{field.name}", type=type(field.default), default=field.default
        )
    args = parser.parse_args(argv)
    with parser.refusing():
        out = _write(args)
    command_line.say(f"wrote {out}")
    return command_line.DONE


def _write(args: argparse.Namespace) -> Path:
    """Writes the pictures that the flags ask for; returns their file."""
    suffix = ".gif" if args.gif else ".png"
    out: Path = args.out or args.run / f"picture{suffix}"
    if out.suffix != suffix:
        raise ValueError(f"out = {str(out)!r}: must end in {suffix}")
    view = View(
        azimuth=args.azimuth,
        elevation=args.elevation,
        distance=args.distance,
        width=args.width,
        height=args.height,
    )
    check(view)
    times = args.times or moments(args.run, args.gif)
    with (
        sync_api.sync_playwright() as playwright,
        launch_chromium(playwright) as browser,
        appearing(out.parent) as drafts,
    ):
        page = open_replay(
            browser, args.run / "replay.html", times=times, view=view
        )
        write = write_gif if args.gif else write_strip
        write(page, times, view, out=drafts / out.name)
    return out


def moments(run: Path, gif: bool = False) -> list[float]:
    """Finds the times of the pictures, or of the frames of an animation.

    Args:
        run: folder of the run.
        gif: of an animation.

    Returns:
        The times [s].

    Raises:
        ValueError: the run has no push, or its log is not complete.
        OSError: the log does not exist.
    """
    try:
        # Opened here, because numpy does not close a corrupt archive.
        with (
            open(run / "log.npz", "rb") as file,
            np.load(file, allow_pickle=False) as data,
        ):
            log = dict(data)
        pushed, landed = pushes(log), steps(log)
    except (BadZipFile, EOFError, KeyError, ValueError) as error:
        raise ValueError(
            f"run = {str(run)!r}: must have a whole log.npz and summary.json, "
            f"as --times are not given ({error!r}{other_version(run)})"
        ) from error
    if not pushed:
        raise ValueError("times: must be given, without a push")
    start, end = pushed[-1].start, pushed[-1].end
    if gif:
        # The replay's last frame may be before the log's last row.
        return np.arange(
            max(start - _GIF[0], 0.0),
            min(end + _GIF[1], float(log["t"][-1]) - REGIONS_PERIOD),
            REGIONS_PERIOD,
        ).tolist()
    landings = [step.swing.end for step in landed if step.swing.end > end]
    return [end, *(t - _BEFORE for t in landings[:_NUM_STEPS])]


def launch_chromium(playwright: sync_api.Playwright) -> sync_api.Browser:
    """Starts a headless Chromium: the system's, else playwright's own.

    Args:
        playwright: that starts it.

    Returns:
        The browser.

    Raises:
        ValueError: Chromium is missing or does not start.
    """
    try:
        return playwright.chromium.launch(
            executable_path=shutil.which("chromium")
            or shutil.which("google-chrome"),
            args=_FLAGS,
        )
    except sync_api.Error as error:
        raise ValueError(
            "Chromium is missing or does not start: apt-get install "
            "chromium, or playwright install chromium"
        ) from error


def open_replay(
    browser: sync_api.Browser, replay: Path, times: list[float], view: View
) -> sync_api.Page:
    """Opens a replay.

    Args:
        browser: that shows it.
        replay: the file.
        times: that must be in it [s].
        view: size of the page.

    Returns:
        The page.

    Raises:
        ValueError: it is no whole replay, or a time is not within it.
    """
    page = browser.new_page(
        viewport={"width": view.width, "height": view.height},
        device_scale_factor=_SHARPNESS,
        offline=True,
    )
    page.set_default_timeout(_PATIENCE)
    try:
        page.goto(replay.resolve().as_uri())
        page.wait_for_function("viewer.animator.duration > 0")
        page.evaluate("document.body.append(document.all.legend)")
        duration = page.evaluate("viewer.animator.duration")
    except sync_api.Error as error:  # a TimeoutError, too
        raise ValueError(
            f"run = {str(replay.parent)!r}: must have a whole {replay.name} "
            f"({error.message.splitlines()[0]})"
        ) from error
    for time in times:
        if not 0.0 <= time <= duration:
            raise ValueError(
                f"times = {time}: must be within the replay, "
                f"[0, {duration:.2f}] s"
            )
    return page


def write_strip(
    page: sync_api.Page, times: list[float], view: View, out: Path
) -> None:
    """Writes pictures side by side over the legend.

    Args:
        page: with the replay.
        times: of the pictures [s].
        view: of the camera.
        out: file of the strip.
    """
    page.add_style_tag(content=_CAPTION)
    pictures = [
        _picture(page, time, view, caption=f"{time:.2f} s") for time in times
    ]
    width = len(times) * (view.width + _GAP) - _GAP
    page.set_viewport_size({"width": width, "height": view.height})
    legend = _image(page.locator("#legend").screenshot(style=_LEGEND))
    strip = Image.new("RGB", (width, view.height + legend.height), "white")
    for i, picture in enumerate(pictures):
        strip.paste(picture, (i * (view.width + _GAP), 0))
    strip.paste(legend, (0, view.height))
    strip.save(out)


def write_gif(
    page: sync_api.Page, times: list[float], view: View, out: Path
) -> None:
    """Writes an animation, in a loop; all frames share one palette.

    It is slower than real time by _SLOWER if the times are as far apart as
    those of `moments`.

    Args:
        page: with the replay.
        times: of the frames [s].
        view: of the camera.
        out: file of the animation.
    """
    page.add_style_tag(content=_WORDS)
    # A camera that stays lets most of a frame be as it was.
    frames = [
        _picture(page, time, view, aims=time is times[0]) for time in times
    ]
    palette = _palette(frames)
    first, *others = (
        frame.quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    )
    period = round(1000 * REGIONS_PERIOD * _SLOWER)
    first.save(
        out,
        save_all=True,
        append_images=others,
        duration=[*(period for _ in others), round(1000 * _HOLD)],
        loop=0,
    )


def _palette(frames: list[Image.Image]) -> Image.Image:
    """An image with a palette for all frames: the legend's colours, and others.

    Of a colour there are as many pixels as the root of their number in the
    frames, which keeps rare ones; in between, colours are rounded.
    """
    pixels = np.concatenate([np.asarray(one)[::2, ::2] for one in frames])
    rounded = pixels.reshape(-1, 3).astype(np.uint32) & 0xFC
    values, counts = np.unique(
        rounded @ np.array([1 << 16, 1 << 8, 1], dtype=np.uint32),
        return_counts=True,
    )
    chosen = np.repeat(values, np.sqrt(counts).astype(int))
    parts = chosen[:, None] >> np.array([16, 8, 0], dtype=np.uint32) & 0xFF
    drawn = [bytes.fromhex(entry.color[1:]) for entry in LEGEND.values()]
    image = Image.fromarray(parts.astype(np.uint8)[None])
    others = image.quantize(256 - len(drawn), method=Image.Quantize.MEDIANCUT)
    image = Image.new("P", (1, 1))
    image.putpalette(b"".join(drawn) + bytes(others.getpalette() or ()))
    return image


def _picture(
    page: sync_api.Page,
    time: float,
    view: View,
    caption: str = "",
    aims: bool = True,
) -> Image.Image:
    """The page at a time [s]; where it `aims`, the camera is at the robot."""
    azimuth = math.radians(view.azimuth)
    elevation = math.radians(view.elevation)
    horizontal = math.cos(elevation)
    page.evaluate(
        _LOOK,
        {
            # The nearest time at which all objects were drawn: in between, a
            # replay interpolates between two shapes of a polygon.
            "time": round(time / REGIONS_PERIOD) * REGIONS_PERIOD,
            "caption": caption,
            "aims": aims,
            "path": MIDDLE.strip("/").split("/"),
            "height": _TARGET,
            "offset": [
                view.distance * (horizontal * math.cos(azimuth)),
                view.distance * (horizontal * math.sin(azimuth)),
                view.distance * math.sin(elevation),
            ],
        },
    )
    return _image(page.screenshot())


def _image(screenshot: bytes) -> Image.Image:
    return Image.open(io.BytesIO(screenshot)).convert("RGB").reduce(_SHARPNESS)


if __name__ == "__main__":
    sys.exit(main())
