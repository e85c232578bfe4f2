"""From anybody's URDF to a robot folder of ours (extra `robots`)."""
