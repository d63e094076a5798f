"""Numbers of MJCF files: what a scene says of options, and what is no number at all."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np

from pirrht.arrays import Array
from pirrht.errors import OptionError, SceneError
from sim.options import NUMERICS

MOTION = "pirrht_motion_"  # with the name of a body: how it moves (`sim.mjcf.motions`)
FAR = 1e6  # [m]; whatever stands or reaches farther is a slip of the pen


def option_defaults(spec: mujoco.MjSpec, path: Path) -> dict[str, float]:
    """What a scene says of options, by their names.

    Raises:
        SceneError: there is no such option, or it cannot have that value; names the element.
    """
    defaults = {}
    for numeric in spec.numerics:
        if not numeric.name.startswith("pirrht_"):
            continue
        if numeric.name.startswith(MOTION):
            continue
        name, values = numeric.name.removeprefix("pirrht_").replace("_", "-"), list(numeric.data)
        label = f'{path}: custom numeric "{numeric.name}"'
        try:
            if name not in NUMERICS:
                known = ", ".join("pirrht_" + option.replace("-", "_") for option in NUMERICS)
                raise SceneError(f"{label} is no option; those are {known}, and {MOTION}BODY is the motion of a body")
            if len(values) != 1 or math.isnan(values[0]):
                raise SceneError(f"{label} is {values}; write one finite number")
            NUMERICS[name].check(float(values[0]), label)
        except OptionError as error:
            raise SceneError(str(error)) from None
        defaults[name] = float(values[0])
    return defaults


def refuse_far(label: str, path: Path, *numbers: Array) -> None:
    """Refuse what stands or reaches farther than any scene does [m].

    Raises:
        SceneError: names file and element.
    """
    for values in numbers:
        wrong = np.asarray(values, dtype=float).ravel()
        wrong = wrong[~(np.abs(wrong) <= FAR)]
        if len(wrong):
            raise SceneError(f"{path}: {label} has a place or size of {wrong[0]:g} m; write at most {FAR:g} m")
