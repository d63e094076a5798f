"""Pose moving obstacles, measure how far the robot is from them, and certify steps among them.

obstacles          J moving obstacles as arrays for kernels; collision: the same obstacles as FCL has them
distances          poses, clearances and walls at a time, in kernels
exits              meetings of a sampled step with a moving obstacle
certify            certificates of straight steps in space and time
broad_phase        obstacles that may be near a cell of space and time, or near one path
tuning             numbers that trade accuracy for time or memory, and widths of arrays

It imports geometry and compilation; the method takes it through `geometry.world`, but for some kernels.
"""
