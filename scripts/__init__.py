"""The main programs."""
