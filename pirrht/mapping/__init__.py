"""Map what a lidar sees: where its rays ended, and through which cells they led.

scan          ranges of one turn of a lidar, and the pose they were measured at
occupancy     a grid of log-odds, which becomes a scene of boxes
tracker       moving obstacles, from scan to scan
believed      what of it a plan rested on
tuning        evidence of rays

It knows neither robots nor simulators, and imports `geometry` and `jit` alone.
"""
