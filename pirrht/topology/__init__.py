"""Ways around obstacles: homology classes of planar paths (paper, section IV-A).

obstacles     what can be wound around: components of the obstacles inflated by the robot's radius
homology      representative points zeta_l, H-signatures, and the integers that classes are
cuts          the ray behind each marker, and which of them a segment crosses
turns         whole turns of curves as (marker, turn) pairs, and their sums along edges
tracks        where markers of bodies that move are, and how far steps in space and time turn about them
moving        turns about bodies that move, of paths in space and time, and the classes that follow
in_time       classes among markers that stand and markers that move, edge by edge
bases         bases of the vertices of a graph that grows among bodies that move, kept
driven        the path driven so far, which goes before every class

H = 1 + H(straight line to the goal point) + integers, so that equal classes are equal tuples and no tolerance is
needed. It may import `geometry` and `compiled`.
"""
