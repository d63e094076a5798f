"""Runs that a person interferes with: pushes the robot, moves goal and obstacles, changes the noise."""
