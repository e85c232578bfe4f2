"""Results of a run: log, summary, story, plots, replay."""
