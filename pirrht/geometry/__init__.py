"""What is free: the domain D of the paper's section II, between solid obstacles, for a robot that plans as a sphere.

scene         a scene as plain values: world, footprint and task
shapes        distances from solids in closed form; fcl_shapes: solids as objects of FCL
collision     how far the obstacles are and whether a path is free: FCL's word, which is the last one
walls         the two nearest walls: the nearest solid, and the nearest in another direction
field         both distances on a grid with their error bound, for millions of questions at once
solids        obstacles from plain numbers; rectangles: few that cover a set of cells
survey        how a field is sampled: dense, on one grid in a small world; blocks, fine where needed in a large one
flat          cells in which distances are linear, so that coarse blocks err by nothing
certify       what the field certifies about points, segments and curves (`ObstacleFree` of Algorithms 2 and 3)
saddles       where free space narrows before it widens again; passages: how wide it is there, and the way through
pages         the same search where the field lies in blocks
motion        how obstacles move, as plain values of a scene
arcs          curves of arcs and straight pieces, and the angle of a chord, absmin of section IV-A
fitting       a start inside the safety margin and a goal that is partly covered, fitted to the walls
world         what is free at (x, t): the interface of sampler, proposals, replay and feedback law

It may import `compiled` and the root's arrays and errors. Only collision and fcl_shapes know FCL.
"""
