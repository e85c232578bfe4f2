"""Everything that a reader sees of a sweep: pictures and tables."""

from pathlib import Path

import matplotlib as mpl

from diagrams.envelope.envelope_data import Envelope, characteristic_speed
from diagrams.envelope.report_text import report_text
from diagrams.plots import envelope as envelope_plot
from diagrams.plots import envelope_bars, envelope_phases
from diagrams.plots.style import RC

PLOTS = {
    "envelope.png": envelope_plot.draw,
    "phases.png": envelope_phases.draw,
    "bars.png": envelope_bars.draw,
}
TABLES = "tables.md"


def write_report(folder: Path, envelope: Envelope) -> list[str]:
    """Writes plots and tables into `folder`, and returns their names.

    Raises:
        OSError: the folder cannot be written to.
    """
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
