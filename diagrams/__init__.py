"""Closed diagrams that simulate, and the scenarios they run."""
