"""Balance control for walking humanoids, on Drake."""
