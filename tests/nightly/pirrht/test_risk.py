"""The exact law among moving obstacles, held for a physics step, with and without a margin."""

from sim.scenario import prepare


def test_a_margin_keeps_the_exact_held_law_from_a_door_that_closes():
    chances = []
    for margin in (0.0, 0.0056):
        scenario = prepare("closing_door", noise=0.1, margin=margin)
        chances.append(scenario.truth().collision_probability(scenario.start, 300, step=0.002, margin=margin)[0])
    assert chances[0] > 0.08 > 0.03 > chances[1]  # 15 % and 0.4 %, errors of 2 % and 0.4 %
