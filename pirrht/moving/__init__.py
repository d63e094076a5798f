"""Moving obstacles: where each is at a time, how far the robot is from it, and what surely passes it.

obstacles          J moving obstacles as arrays for kernels; collision: the same obstacles as FCL has them
distances          poses, clearances and walls at a time, in kernels; bodies: solids, with tables of FCL's distances
exits              how a sampled step meets a moving obstacle
certify            certificates of straight steps in space and time
spans              where an obstacle is within spans of time, as boxes
broad_phase        which obstacles may be near a cell of space and time; broad_phase_cache: near one path

The package imports the core; `pirrht.geometry` imports none of it.
"""
