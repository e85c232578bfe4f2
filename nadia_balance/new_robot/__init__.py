"""Conversion of any robot's URDF or MJCF to a robot folder (extra `robots`)."""
