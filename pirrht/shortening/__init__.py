"""References pulled taut inside their homology class (after Algorithm 5; the paper leaves them as the tree has them).

`shorten` chooses by steering method, `polyline` does straight lines: shortcuts between corners, and corners blunted
as far as obstacles allow. For Dubins curves `dubins_shortcut` replaces stretches by the best chain of curves between
stations, `dubins_bends` moves the joints where the chain bends, `dubins_legs` is what both are made of. In space and
time `in_time` leaves out knots, and `timed_relaxation` moves them. While a robot drives `arcs_resumed` goes on with a
rover's last references, `chain` with a mass's.

No path gets longer, every new piece is certified by the clearance field, and its turns around the markers are those of
what it replaces. Any other steering method gets the cheapest chain of its own connections (`chain`). It imports
steering and what lies below.
"""
