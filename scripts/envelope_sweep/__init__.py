"""Sweeps that find the largest pushes that a robot recovers from."""
