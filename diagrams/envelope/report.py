"""Everything that a reader sees of a sweep: pictures and tables."""

from pathlib import Path

import matplotlib as mpl

from diagrams.envelope.envelope_data import characteristic_speed, envelope_of
from diagrams.envelope.report_text import report_text
from diagrams.envelope.trials_file import read_trials
from diagrams.plots import envelope as envelope_plot
from diagrams.plots import envelope_bars, envelope_phases
from diagrams.plots.style import RC

PLOTS = {
    "envelope.png": envelope_plot.draw,
    "phases.png": envelope_phases.draw,
    "bars.png": envelope_bars.draw,
}
TABLES = "tables.md"


def write_report(folder: str | Path) -> list[str]:
    """Writes plots and tables of the trials.csv in `folder`.

    Returns the names of the files; without any trial there are none.

    Raises:
        ValueError: it is no file of trials.
        OSError: it cannot be read, or the folder not be written to.
    """
    folder = Path(folder)
    identity, rows = read_trials(folder / "trials.csv")
    if not rows:
        return []
    envelope = envelope_of(identity, rows)
    written = []
    with mpl.rc_context(RC):
        for name, draw in PLOTS.items():
            if (figure := draw(envelope)) is not None:
                figure.savefig(folder / name)
                written.append(name)
    speed = characteristic_speed(envelope.robot)
    text = report_text(envelope, speed, written)
    (folder / TABLES).write_text(text, encoding="utf-8")
    return [*written, TABLES]
