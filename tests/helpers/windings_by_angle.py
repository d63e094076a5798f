"""The paper's H of a curve, marker by marker: what the method finds at cuts is held against it."""

from pirrht.geometry.arcs import along, turns_of_piece
from pirrht.jit.jit import kernel


@kernel
def turns_of_curve(start, curvature, length, markers, out):  # type: ignore[no-untyped-def]
    """Write H (M,) of a curve without the 1 (paper, section IV-A) to out; returns the curve's end."""
    out[:] = 0.0
    x, y, theta = start[0], start[1], start[2]
    for p in range(length.shape[0]):
        for k in range(markers.shape[0]):
            out[k] += turns_of_piece(x, y, theta, curvature[p], length[p], markers[k, 0], markers[k, 1])
        x, y, theta = along(x, y, theta, curvature[p], length[p])
    return x, y
