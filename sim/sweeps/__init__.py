"""Many drives: every combination of scene, method, noise and seed, kept, repeated and reported."""
