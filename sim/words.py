"""Numbers with their nouns."""


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number and what it counts, as in 1 run and 2 runs; `plural` where it is no mere s."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"
