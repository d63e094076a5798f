"""Shorten references inside their homology class (after Algorithm 5; the paper leaves them as the tree has them).

`shorten` chooses by steering method, and does straight lines: shortcuts between corners, and corners blunted as far as
obstacles allow. In space and time `in_time` leaves out knots, and `timed_relaxation` moves them. Any other
steering method gets the cheapest `chain` of its own connections. `tuning` has the numbers.

No path gets longer; every new piece is certified by the clearance field and turns around the markers as the piece it
replaces. It imports steering and what lies below.
"""
