"""What is left of a run: log, summary, story, plots, replay."""
