"""The expansion phase: a goal-rooted tree in the H-augmented space, and the references that it gives.

tree       `HomologyTree`: Algorithms 1 (Expansion), 2 (ChooseParent) and 3 (Rewire), to be read from top to bottom
limits     `grown_tree`: a tree within the least limit that keeps short classes
references Algorithm 5 (ExtractReference): paths of all classes, shortened by the steering method
expand     Algorithm 1 for many draws in one kernel, and draws in passages
rewire     Algorithms 2 and 3 in kernels: classes that a vertex keeps (AppendNode), and the search over the queue
graph      vertices, edges and nodes in memory: all of a tree that changes
tuning     tuned numbers

An edge is known only to its kind of motion (`steering.motion`), a class only to its `Signature`: nothing here depends
on the dimension of space, and no cost is taken to be a length. It imports steering and layers below it; it knows
neither noise nor control.
"""
