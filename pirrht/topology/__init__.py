"""Tell homology classes of planar paths apart (paper, section IV-A).

obstacles     components of the obstacles inflated by the robot's radius, around which paths can wind homology
representative points zeta_l, H-signatures, and classes as integers cuts          the ray behind each marker, and which
of them a segment crosses turns         whole turns of curves as (marker, turn) pairs, and their sums along edges tracks
trajectories of markers of moving obstacles, and turns of steps in space and time about them moving        turns of
paths in space and time about moving obstacles, and their classes in_time       classes among static and moving markers,
edge by edge, and cached bases marks         whole turns of sampled paths, found at rays that move along driven
the path driven so far, which goes before every class

H = 1 + H(straight line to the goal point) + integers: equal classes are equal tuples, without a tolerance. It imports
`geometry` and `compiled`.
"""
