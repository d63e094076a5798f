"""Small scenes with one question each: two slits, a bridge, a trap."""

from worlds.page import Page, box, seen


def double_slit() -> Page:
    """Kappen's example: which slit, and when is that decided?"""
    return Page(
        name="double_slit",
        about="Two slits alike: with much noise stay between them, and choose late.",
        why="Two slits in one wall, alike but for a finger's breadth (after Kappen, J. Stat. Mech. 2005).",
        size=(6.0, 5.0),
        start=(0.8, 2.5),
        goal=(5.4, 2.52, 0.3),
        settings={"noise": 0.2, "limit": 0.9},
        elements=[
            box("lower wall", (3.15, 3.35), (0.55, 1.55)),
            box("middle wall", (3.15, 3.35), (2.05, 2.95)),
            box("upper wall", (3.15, 3.35), (3.45, 4.45)),
        ],
    )


def drunken_bridge() -> Page:
    """Kappen's drunken spider: over the bridge while sober, around the lake otherwise."""
    planks = [
        seen("box", f"{x:g} 2.5 0.008", "0.09 0.22 0.008", "plank")
        for x in (2.4, 2.6, 2.8, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0, 4.2)
    ]
    return Page(
        name="drunken_bridge",
        about="A bridge without rails over a lake: short for the sober, and a bath for the drunk, who walk around.",
        why="Water is an obstacle, low boxes that reach into the robot's height; the bridge is 0.4 m wide.",
        size=(6.6, 5.0),
        start=(1.0, 2.5),
        goal=(5.7, 2.5, 0.3),
        settings={"limit": 0.9},
        elements=[
            box("north lake", (2.3, 4.3), (2.7, 3.6), 0.06, "water"),
            box("south lake", (2.3, 4.3), (1.3, 2.3), 0.06, "water"),
            *planks,
        ],
    )


def u_trap() -> Page:
    """The straight way ends in a pocket."""
    return Page(
        name="u_trap",
        about="The straight way ends in a pocket: leave by a narrow gap below, or by the longer way above.",
        why="A pocket that is open towards the start, and a beam that leaves a gap of 0.45 m below it.",
        size=(6.0, 5.0),
        start=(0.9, 2.3),
        goal=(5.2, 2.3, 0.3),
        settings={"limit": 0.9},
        elements=[
            box("upper arm", (2.2, 3.8), (3.3, 3.42)),
            box("back", (3.68, 3.8), (1.42, 3.3)),
            box("lower arm", (2.2, 3.8), (1.3, 1.42)),
            box("beam", (2.5, 3.5), (0.73, 0.85), material="steel"),
        ],
    )
