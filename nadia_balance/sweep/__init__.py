"""Sweeps of pushes: trials, searches of limits, reports."""
