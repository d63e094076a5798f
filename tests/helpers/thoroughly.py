"""Parameters with which a test says again what it has said already: `--thorough` runs them too."""

import pytest


def thorough(*values, id: str | None = None):
    """One set of values of `parametrize` that only the thorough suite takes."""
    return pytest.param(*values, id=id, marks=pytest.mark.thorough)


def first(values, kept: int = 1) -> list:
    """Values of `parametrize`, of which the suite takes the first ones and the thorough suite all."""
    values = list(values)
    more = (value if isinstance(value, tuple) else (value,) for value in values[kept:])
    return values[:kept] + [thorough(*value) for value in more]
