"""A drive: the plant in MuJoCo or by its equation, the loop around it, against the clock too, and what it came to."""
