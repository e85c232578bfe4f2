"""What all tests share: reproducible hypotheses, and one browser."""

import os
from collections.abc import Iterator

import hypothesis
import pytest
from playwright.sync_api import Browser, sync_playwright

from diagrams.pictures import launch_chromium

os.environ.setdefault("MPLBACKEND", "Agg")

# The same examples in every run, and no deadline on a machine that is shared.
hypothesis.settings.register_profile(
    "reproducible", deadline=None, derandomize=True
)
hypothesis.settings.load_profile("reproducible")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A headless Chromium: the system's, else the one playwright got."""
    with sync_playwright() as playwright:
        browser = launch_chromium(playwright)
        yield browser
        browser.close()
