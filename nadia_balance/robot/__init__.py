"""A robot: its folder, its model, and its kinematics in Drake."""
