"""What the tests of all scripts share."""

import pytest

from nadia_balance.results import pages


@pytest.fixture(autouse=True)
def no_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are tested with the results, and take longer than the runs."""
    monkeypatch.setattr(pages, "write_plots", lambda *_: [])
