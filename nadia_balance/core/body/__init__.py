"""What the robot can do: mass, reach, ground, drives, height."""
