"""Makes a robot's folder of somebody's URDF or MJCF."""
