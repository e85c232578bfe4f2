"""Estimation of the robot's state from its sensors."""
