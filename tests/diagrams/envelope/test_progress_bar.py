"""The bar shows what it is told; the oracle is the text on stderr."""

from diagrams.envelope.agenda import Progress
from diagrams.envelope.progress_bar import progress_bar


def told(done, total, complete):
    return Progress(done=done, total=total, complete=complete, cells=6)


def test_ends_with_all_trials_and_all_limits(capsys):
    with progress_bar(told(0, 80, 0)) as show:
        show(told(0, 80, 0))
        show(told(1, 90, 0))
        show(told(95, 95, 6))
    last = capsys.readouterr().err.split("\r")[-1]
    assert "100%" in last
    assert "95/95" in last
    assert "6/6 limits found" in last


def test_begins_with_what_is_done_already(capsys):
    """What an earlier run took no time is not counted as fast."""
    with progress_bar(told(20, 80, 1)) as show:
        first = capsys.readouterr().err.split("\r")[-1]
        show(told(20, 80, 1))
    assert "20/80" in first
    assert "0.00trial/s" in first or "?trial/s" in first
