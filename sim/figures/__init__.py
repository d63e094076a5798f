"""Maps of plans, with matplotlib."""
