"""A run is told while it goes on, on a terminal only."""

import io

from nadia_balance.diagrams.simulation import advance, start
from nadia_balance.scripts.progress import progress
from tests.diagrams.simulated import diagram_of

TEXT = "{duration: 3.0, mechanisms: all_with_cross_over, calm_steps: 2, "
TEXT += "pushes: [{delta_v: 0.3, at: 1 s}]}"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def shown_on(stream) -> str:
    """What a run of the point mass shows there."""
    diagram = diagram_of(TEXT, "lipm")
    with progress(diagram, stream) as show:
        advance(start(diagram), 3.0, until=lambda now: bool(show(now)))
    return stream.getvalue()


def test_a_terminal_shows_each_event_and_a_bar_of_time():
    """Oracle: by hand: the push at 1 s, which ankles hold."""
    shown = shown_on(Terminal())
    assert "t=1.0 s  push 0.30 m/s" in shown or "t=1.1 s  push 0.30" in shown
    assert "RECOVERED without a step" in shown
    assert " of 3 s" in shown


def test_a_file_has_nothing_of_it():
    assert shown_on(io.StringIO()) == ""
