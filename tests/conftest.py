"""What all tests share: reproducible hypotheses, runs, and one browser."""

import os
from collections.abc import Iterator

import hypothesis
import pytest

from tests import run_cache

os.environ.setdefault("MPLBACKEND", "Agg")

# The same examples in every run, and no deadline on a machine that is shared.
hypothesis.settings.register_profile(
    "reproducible", deadline=None, derandomize=True, max_examples=50
)
hypothesis.settings.load_profile("reproducible")


def pytest_configure(config: pytest.Config) -> None:
    """Keeps what is simulated; --cache-clear drops that before the start."""
    if config.pluginmanager.hasplugin("cacheprovider"):
        run_cache.folder = config.cache.mkdir("simulated")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that need the browser come first: one worker has all of them."""
    need = {item.path for item in items if "browser" in item.fixturenames}
    items.sort(key=lambda item: item.path not in need)


@pytest.fixture(scope="session")
def browser() -> Iterator:
    """A headless Chromium: the system's, else the one playwright got."""
    # Here, as most tests need neither of them.
    from playwright.sync_api import sync_playwright

    from picture import launch_chromium

    with sync_playwright() as playwright:
        browser = launch_chromium(playwright)
        yield browser
        browser.close()
