"""Scenes and robots from MJCF files: what they declare by convention, joined into one model (`load`)."""

from sim.mjcf.library import models_folder, robot_names, scene_names
from sim.mjcf.load import Loaded, load

__all__ = ["Loaded", "load", "models_folder", "robot_names", "scene_names"]
