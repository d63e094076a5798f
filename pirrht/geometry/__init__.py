"""Describe the domain D of the paper's section II: free space among solid obstacles for a robot that plans as a sphere.

scene         a scene as plain values: world, footprint and task
shapes        distances from solids, in closed form or by few steps
collision     distances of obstacles, and free paths by FCL, which decides where the field is unsure
walls         the two nearest walls: the nearest solid, and the nearest in another direction
field         both distances on a grid with their error bound, for millions of questions at once
blocks        sampling of a field: one grid in a small world, blocks that are fine where needed in a large one
solids        obstacles from plain numbers; rectangles: few that cover a set of cells
passages      places where free space narrows before it widens again, their widths and axes
obstacle      solids and motions of obstacles, as plain values of a scene
arcs          curves of arcs and straight pieces, the angle of a chord (absmin of section IV-A), and certificates that
              points, segments and curves are free (`ObstacleFree` of Algorithms 2 and 3)
fitting       a start inside the safety margin and a goal that is partly covered, fitted to the walls
world         what is free at (x, t): the interface of sampler, proposals, replay and feedback law

It may import `jit` and the root's arrays and errors. Only `collision` knows FCL.
"""
