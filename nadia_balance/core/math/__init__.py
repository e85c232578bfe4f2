"""Arrays, bounds and units of parameters, polygons, the pendulum, QPs."""
