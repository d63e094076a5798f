"""What a sweep is asked for comes out of the text that it is written as, and nothing too large does."""

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pirrht.control.settings import METHODS
from pirrht.errors import OptionError
from sim.settings import SEED
from sim.sweeps.sweep import MOST_RUNS, Grid, parse, seeds_of

levels = st.lists(st.floats(1e-6, 1e3), min_size=1, max_size=6, unique=True)


@given(st.text(max_size=12) | st.from_regex(r"[-0-9:_e.,]{1,8}", fullmatch=True))
def test_any_other_text_is_a_range_or_refused_in_one_line(text):
    said = None
    try:
        seeds = seeds_of(text)
    except OptionError as error:
        said = str(error)
    if said is None:
        assert 0 <= seeds.start < seeds.stop <= SEED + 1
    else:
        assert said.startswith("--seeds")
        assert len(said.splitlines()) == 1


@settings(max_examples=40)
@given(
    methods=st.lists(st.sampled_from(sorted(METHODS)), min_size=1, unique=True),
    noises=levels,
    first=st.integers(0, 50),
    count=st.integers(1, 5),
)
def test_every_combination_is_one_job_in_the_order_of_the_text(methods, noises, first, count):
    words = {"methods": ", ".join(methods), "noise": ",".join(map(repr, noises)), "seeds": f"{first}:{first + count}"}
    grid = parse({"scenes": ["slit", "a/b.xml"], "goal": [1, 2], "threads": 2, "plan_seed": 0, **words})
    jobs = grid.jobs()
    expected = product(("slit", "a/b.xml"), noises, methods, range(first, first + count))
    assert [(j.scene, j.noise, j.method, j.seed) for j in jobs] == list(expected)
    assert {k: v for k, v in grid.settings.items() if v is not None} == {"goal": (1, 2), "plan_seed": 0}


def test_as_many_runs_as_memory_holds_are_asked_for_at_most():
    kept = {"scenes": ("slit",), "methods": ("pi-rrht",), "noises": (None,), "given": ()}
    Grid(seeds=range(MOST_RUNS), **kept)
    for seeds in (range(MOST_RUNS + 1), range(10**12), range(10**30)):
        with pytest.raises(OptionError, match=f"{MOST_RUNS} at most.*-o DIR takes the others later"):
            Grid(seeds=seeds, **kept)
