"""Arrays, polygons, segments, the pendulum, QPs."""
