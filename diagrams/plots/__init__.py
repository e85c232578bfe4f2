"""The plots of a run, drawn from its log and its summary alone."""
