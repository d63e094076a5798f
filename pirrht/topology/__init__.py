"""Homology classes of paths (paper, section IV-A).

signature          interface: base, crossings, key of a class
homology           signature of planar paths about static and moving obstacles, and class of the path driven so far
crossings          rays behind static markers, and which of them segments and arcs cross
tracks             trajectories of moving markers, and angles of steps about them
moving_crossings   rays of moving markers that legs and sampled paths cross
obstacles          components of the inflated obstacles, around which paths can wind

H = 1 + H(base) + integers: equal classes are equal tuples, without a tolerance. It imports `geometry` and `jit`.
"""
