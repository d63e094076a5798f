"""Homology classes of paths (paper, section IV-A).

signature          interface: kernels of base, crossings and key of a step; key and name of a class
choice             choose the signature of a scene
driven             class of the path driven so far
pairs              classes as (obstacle, turn) pairs
homology           signature of planar paths about static and moving obstacles
crossings          rays behind static markers, and which of them segments and arcs cross
tracks             trajectories of moving markers, and angles of steps about them
moving_crossings   rays of moving markers that legs and sampled paths cross
tuning             numbers that were tuned
obstacles          components of the inflated obstacles, around which paths can wind

H = 1 + H(base) + integers: equal classes are equal tuples, without a tolerance. It imports `geometry` and `jit`.
"""
