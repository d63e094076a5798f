"""The expansion phase: a goal-rooted tree in the H-augmented space, and the references that it gives.

`homology_tree` is what others use; `extend` is Algorithm 1 (states become vertices), `nodes` AppendNode (which
classes a vertex keeps, under |1 - H_i| <= H_limit), `search` Algorithms 2 and 3 (ChooseParent and Rewire as one
uniform-cost search) and the search of Algorithm 5, `around` which vertices are near a state and which edges to them
are free, `asking` the rest of Algorithm 5 (paths of all classes, shortened: `reference`), `valleys` which other ways of
a class are worth shortening among bodies that move, `offers` says which draws lie in passages, `graph` how all of it
lies in memory. `file` keeps grown trees, which `archive` reads and `checks`
examines; `convergence` watches paths get shorter (the paper's Fig. 3a).

What an edge is only its kind of motion knows (`steering.motion`): nothing here asks for its shape, and no cost is
taken to be a length. It imports steering, shortening and what lies below them; it knows neither noise nor control.
"""
