"""Physics other than Drake's: MuJoCo, and the point mass."""
