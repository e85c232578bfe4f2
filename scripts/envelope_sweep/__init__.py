"""Finds the largest pushes that a robot recovers from."""
