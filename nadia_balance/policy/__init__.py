"""Learned policies: their contracts, observations and controller."""
