"""How the scenes of the gallery are made; `scripts/make_scenes.py` writes them."""
