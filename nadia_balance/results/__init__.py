"""Results of a run: its log, summary, story, plots and pages."""
