"""Conversion of any robot's URDF to a robot folder (extra `robots`)."""
