"""Where a Chromium is, and how it draws WebGL without a graphics card."""

import os
import shutil

NAMES = ("chromium", "chromium-browser", "google-chrome")

FLAGS = (
    "--no-sandbox",  # there is none for root
    "--use-gl=angle",  # any other value gives a blank page
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--disable-background-networking",
)


def find_chromium() -> str | None:
    """The one named by $CHROMIUM, else the system's.

    None means playwright's own, which `playwright install chromium` gets.
    """
    named = os.environ.get("CHROMIUM")
    if named:
        return named
    return next(filter(None, map(shutil.which, NAMES)), None)
