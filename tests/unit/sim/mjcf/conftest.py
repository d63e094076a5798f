"""Files of scenes and robots, written where tests need them."""

import pytest


@pytest.fixture
def write(tmp_path):
    def write(text: str | bytes, name: str = "scene.xml"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogateescape"))
        return path

    return write
