"""How samples are shared by a guide and what goes beside it."""

from __future__ import annotations

import numpy as np

from pirrht.control.aside import Aside
from pirrht.guidance.leads import Proposal, Tape

TIMES = np.arange(3.0)


def tape() -> Tape:
    return Tape(TIMES, np.zeros((2, 2)))


def test_only_classes_with_the_most_samples_have_some_beside_their_guides_and_none_is_lost():
    ways = [tape(), tape(), tape()]
    aside = Aside()
    aside.shares["b"] = 0.2
    asked = [Proposal(lead=tape(), count=count, name=name) for name, count in (("a", 300), ("b", 300), ("c", 30))]
    found = aside.split(asked, ways.__getitem__)
    assert [(one.name, one.count) for one in found] == [("a", 150), ("b", 240), ("c", 30), ("a", 150), ("b", 60)]
    assert [one.lead for one in found[3:]] == ways[:2]
