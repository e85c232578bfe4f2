"""The plots of a run, and the figures of the papers."""
