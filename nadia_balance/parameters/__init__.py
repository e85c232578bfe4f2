"""Parameters: bounds, scaling to other robots, and their files."""
