"""Speak ROS 2 without an installation of it: its messages over DDS, and in files (MCAP)."""
