"""The push-recovery envelope of a robot: the largest push from any side."""
