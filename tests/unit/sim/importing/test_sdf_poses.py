"""Poses of SDF compose and invert as rigid motions do, whichever way they are written."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim.importing.sdf import Frames
from sim.importing.solids import transform

lengths = st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3)
angles = st.lists(st.floats(-7.0, 7.0), min_size=3, max_size=3)
motions = st.builds(lambda place, turn: np.array([*place, *turn]), lengths, angles)


def about(axis: int, angle: float) -> np.ndarray:
    """The textbook's matrix of a turn about one axis."""
    matrix, (i, j) = np.eye(3), [(1, 2), (2, 0), (0, 1)][axis]
    matrix[[i, j], [i, j]] = np.cos(angle)
    matrix[j, i], matrix[i, j] = np.sin(angle), -np.sin(angle)
    return matrix


def written(matrix: np.ndarray) -> str:
    """A pose element of a quaternion, with the digits that a double has."""
    numbers = [*matrix[:3, 3], *Rotation.from_matrix(matrix[:3, :3]).as_quat()]
    return f'<pose rotation_format="quat_xyzw" relative_to="a">{" ".join(f"{v:.17g}" for v in numbers)}</pose>'


@settings(max_examples=60)
@given(motions)
def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_that_order(values):
    matrix = transform(values)
    expected = about(2, values[5]) @ about(1, values[4]) @ about(0, values[3])
    np.testing.assert_allclose(matrix[:3, :3], expected, atol=1e-12)
    np.testing.assert_array_equal(matrix[:3, 3], values[:3])
    np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])
    degrees = np.append(values[:3], np.degrees(values[3:]))
    np.testing.assert_allclose(transform(degrees, degrees=True), matrix, atol=1e-12)


@settings(max_examples=60)
@given(motions, motions)
def test_a_pose_relative_to_a_frame_composes_and_its_inverse_leads_home(first, second):
    a, b = transform(first), transform(second)
    frames = f'<frame name="a"><pose>{" ".join(f"{v:.17g}" for v in first)}</pose></frame>'
    for name, matrix in (("b", b), ("home", np.linalg.inv(a))):
        frames += f'<frame name="{name}">{written(matrix)}</frame>'
    world = ET.fromstring(f"<world>{frames}</world>")
    found = Frames(world, Path("maze.world"))
    np.testing.assert_allclose(found.resolve("b", world), a @ b, atol=1e-9)
    np.testing.assert_allclose(found.resolve("home", world), np.eye(4), atol=1e-9)
