"""A film that the disk does not take."""

import io

import numpy as np
import pytest

from pirrht.errors import OptionError
from sim import film
from sim.files import replaced


class Full(io.BytesIO):
    """A disk on which there is room for the beginning of a film."""

    def write(self, content) -> int:
        if self.tell() + len(content) > 100_000:
            raise OSError(28, "No space left on device")
        return super().write(content)


def test_a_film_on_a_full_disk_costs_one_line_and_leaves_nothing(tmp_path):
    pytest.importorskip("av")
    rng, file = np.random.default_rng(0), tmp_path / "a.mp4"
    noise = (rng.integers(0, 255, (film.HEIGHT, film.WIDTH, 3), dtype=np.uint8) for _ in range(8))

    def save() -> None:
        with replaced(file, "--video"):
            film._encode(Full(), noise)

    with pytest.raises(OptionError, match="No space left on device"):
        save()
    assert list(tmp_path.iterdir()) == []
