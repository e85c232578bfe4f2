"""Pictures of a replay side by side, taken by a headless Chromium.

Needs playwright, which nothing else but the tests needs: the extra `docs`.
"""

import base64
import html
import shutil
from dataclasses import asdict, dataclass
from pathlib import Path

from playwright.sync_api import (
    Browser,
    Error,
    Page,
    Playwright,
    sync_playwright,
)

from nadia_balance.systems import palette
from nadia_balance.systems.balance_visualizer import MIDDLE, REGIONS_PERIOD

_FLAGS = (
    "--no-sandbox",  # there is none for root
    "--enable-unsafe-swiftshader",  # WebGL without a GPU
)
_SHARPNESS = 2  # pixels of a picture for each pixel of the strip

# Looks at the robot's middle; hides all that is not the scene.
_LOOK = """
({time, path, azimuth_deg, elevation_deg, distance, height}) => {
  for (const node of document.querySelectorAll("#legend, .dg")) {
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


@dataclass(frozen=True, kw_only=True)
class View:
    """From where the robot is seen, and how large a picture is."""

    azimuth_deg: float = 14.0  # 0 from in front, 90 from her left [deg]
    elevation_deg: float = 14.0  # above the horizon [deg]
    distance: float = 3.7  # of the camera from the robot's middle [m]
    height: float = 0.74  # of what it looks at [m]
    width_px: int = 440
    height_px: int = 620

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name, low, high in (
            ("elevation_deg", 0.0, 89.0),
            ("distance", 0.5, 50.0),
            ("height", 0.0, 3.0),
            ("width_px", 50, 4000),
            ("height_px", 50, 4000),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(
                    f"{name} = {value}: must be in [{low}, {high}]"
                )


def launch_chromium(playwright: Playwright) -> Browser:
    """Returns a headless Chromium: the system's, else playwright's own.

    Raises:
        ValueError: there is none, or it does not start.
    """
    found = shutil.which("chromium") or shutil.which("google-chrome")
    try:
        return playwright.chromium.launch(executable_path=found, args=_FLAGS)
    except Error as error:
        raise ValueError(
            "Chromium is missing or does not start: apt-get install "
            "chromium, or playwright install chromium"
        ) from error


def write_strip(
    replay: Path, times: list[float], captions: list[str], view: View, out: Path
) -> None:
    """Writes to `out` (PNG) what `replay` shows at `times` [s], side by side.

    Raises:
        ValueError: `replay` is cut off, or no replay at all; a time is not
            within it; or there is no Chromium.
    """
    view.validate()
    with sync_playwright() as playwright:
        browser = launch_chromium(playwright)
        pictures = _pictures(browser, replay, times, view)
        page = browser.new_page(device_scale_factor=1)
        page.set_viewport_size(
            {"width": len(times) * (view.width_px + 8), "height": 100}
        )
        page.set_content(_strip(pictures, captions, view))
        page.locator("#strip").screenshot(path=out)
        browser.close()


def _pictures(
    browser: Browser, replay: Path, times: list[float], view: View
) -> list[bytes]:
    """Returns a PNG for each of the `times` [s]."""
    page = browser.new_page(
        viewport={"width": view.width_px, "height": view.height_px},
        device_scale_factor=_SHARPNESS,
        offline=True,
    )
    duration = _open(page, replay)
    for time in times:
        if not 0.0 <= time <= duration:
            raise ValueError(
                f"times = {time}: must be within the replay, "
                f"[0, {duration:.2f}] s"
            )
    return [_picture(page, _frame(time), view) for time in times]


def _open(page: Page, replay: Path) -> float:
    """Loads `replay` into the `page`; returns how long it lasts [s]."""
    try:
        page.goto(replay.resolve().as_uri())
        page.wait_for_function("viewer.animator.duration > 0")
        return page.evaluate("viewer.animator.duration")
    except Error as error:  # a TimeoutError, too
        raise ValueError(
            f"run = {str(replay.parent)!r}: must have a whole {replay.name} "
            f"({error.message.splitlines()[0]})"
        ) from error


def _frame(time: float) -> float:
    """The nearest time [s] at which all was drawn; nothing is in between.

    A replay would draw polygons half-way from one shape to another.
    """
    return round(time / REGIONS_PERIOD) * REGIONS_PERIOD


def _picture(page: Page, time: float, view: View) -> bytes:
    page.evaluate(_LOOK, {"time": time, "path": MIDDLE, **asdict(view)})
    return page.screenshot()


def _strip(pictures: list[bytes], captions: list[str], view: View) -> str:
    """The page with all pictures and what their colours mean."""
    figures = "".join(
        '<figure><img src="data:image/png;base64,'
        f'{base64.b64encode(picture).decode()}">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
        for picture, caption in zip(pictures, captions, strict=True)
    )
    legend = "".join(
        f'<span><b style="color:{color}">&#9632;</b> {name}</span>'
        for name, color in palette.LEGEND.items()
    )
    return _STRIP.format(
        width=view.width_px,
        height=view.height_px,
        figures=figures,
        legend=legend,
    )
