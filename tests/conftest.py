"""What all tests share: reproducible hypotheses, and one browser."""

import os
import shutil
from collections.abc import Iterator

import hypothesis
import pytest
from playwright.sync_api import Browser, sync_playwright

os.environ.setdefault("MPLBACKEND", "Agg")

# The same examples in every run, and no deadline on a machine that is shared.
hypothesis.settings.register_profile(
    "reproducible", deadline=None, derandomize=True
)
hypothesis.settings.load_profile("reproducible")

CHROMIUM_FLAGS = (
    "--no-sandbox",  # there is none for root
    "--enable-unsafe-swiftshader",  # WebGL without a GPU
)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A headless Chromium: the system's, else the one playwright got."""
    found = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=found, args=CHROMIUM_FLAGS
        )
        yield browser
        browser.close()
