"""The words of walking: feet, steps, phases, pushes, mechanisms."""
