"""Pose moving obstacles, measure how far the robot is from them, and certify steps among them.

obstacles          J moving obstacles as arrays for kernels; collision: the same obstacles as FCL has them
distances          poses, clearances and walls at a time, in kernels
exits              which are near a path, and how they end a sampled step
certify            certificates of straight steps in space and time
in_space           all of this for balls and boxes in space, without lists: few are there
tuning             numbers that trade accuracy for time or memory, and widths of arrays

It implements `Moving` of `geometry.world`, through which the method takes it.
"""
