"""Pictures of every scene for docs/gallery: a still and a short loop, both of one drive, as MuJoCo shows it.

Three loops show what noise does to a choice: two drives of one scene side by side, with little noise and with much.
"""

import argparse
import io
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from pirrht.errors import PirrhtError
from sim.cli.commands import DEMO_PATHS
from sim.cli.parser import Parser
from sim.files import replaced
from sim.film import Film
from sim.mjcf import load, scene_names
from sim.scenario import prepare

STILL, LOOP = (960, 540), (400, 225)  # width and height of the pictures
HALF = (380, 300)  # of one of two films
SHOTS, PAUSE = 32, 900  # pictures of a loop, and how long its last one stays [ms]
SECONDS = 4.0  # of a loop
NOISES = (0.1, 0.3)  # of the value
MOMENT = 0.45  # of the still, as a share of the drive
VALUE = "value"
FOLDER = Path(__file__).resolve().parents[1] / "docs" / "gallery"
NOTE = (
    "thin: sampled futures; grey: those that hit something; outlines: where the door will be; bar: how probable each "
    "way is"
)
WIND = "thin: sampled flights in the colour of their way; grey: those that never arrive; yellow: flown"
DASHES = {"0,0": "through the gap", "-1,0": "around the wall"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Two drives of a scene, with little noise and with much."""

    scene: str
    noises: tuple[float, float]
    ways: Mapping[str, str]  # what to call classes, by id
    labels: tuple[str, str] = ("little noise", "much noise")
    seed: int = 0  # added to the one that is asked for
    note: str | None = None  # what is to be seen in it


PAIRS = {
    "opening": Pair(scene="slit", noises=NOISES, ways=DEMO_PATHS),
    "wind": Pair(
        scene="gust",
        noises=(0.1, 0.5),
        ways={"0": "over the wall", "1": "through the window"},
        labels=("light wind: noise 0.1", "strong gusts: noise 0.5"),
        note=WIND,
    ),
    "closing_door-noise": Pair(scene="closing_door", noises=NOISES, ways=DASHES, note=NOTE),
}
HEAD = """# Gallery

<!-- Made by scripts/gallery.py. -->

Each built-in scene, seed 0: the robot after 45 % of the run, references as thick as probable, a few samples; and the
whole run. `pirrht run SCENE --record FILE.rrd` records one.
"""


def drive(
    name: str, given: dict[str, Any], *, size: tuple[int, int] | None = None, ways: Mapping[str, str] | None = None
) -> tuple[Film, float]:
    """Drive once; returns a film of it and how long it took [s]."""
    scenario = prepare(name, given=given)
    film = Film(scenario.loaded, size=size or STILL, ways=ways)
    driver = scenario.driver(scenario.grown_tree())
    time = 0.0
    for frame in scenario.drive(scenario.plant(), driver):
        film.add(frame, driver.path_integral)
        time = frame.end_time
    return film, time


def side_by_side(pair: Pair, file: Path, given: dict[str, Any], shots: int) -> None:
    """Two drives, with little and with much noise, as a loop."""
    from figures import opening, snapshots

    from pirrht.plotting.maps import pyplot

    seeded = {**given, "seed": given["seed"] + pair.seed}
    choices = [{**seeded, "noise": noise} for noise in pair.noises]
    plt, look = pyplot("this script"), {"labels": pair.labels}
    look |= {} if pair.note is None else {"note": pair.note}
    if load(pair.scene).scene.dimension == 3:
        films, ends = zip(*(drive(pair.scene, one, size=HALF, ways=pair.ways) for one in choices), strict=True)
        made = list(opening.filmed(plt, films, times=np.linspace(0.0, max(ends), shots).tolist(), **look))
    else:
        drives = [snapshots.drive(prepare(pair.scene, given=one), (0.0,)) for one in choices]
        times = np.linspace(0.0, max(one.frames[-1].end_time for one in drives), shots).tolist()
        made = list(opening.pictures(plt, drives, times=times, ways=pair.ways, **look))
    height, width, _ = made[0].shape
    write_loop(made, file, size=(width, height), quality=45)


def value_map(file: Path) -> None:
    """The exact value of `slit` at both noise levels."""
    from figures import opening, value_map

    from pirrht.plotting.maps import pyplot

    plt = pyplot("this script")
    figure = value_map.draw(plt, [prepare("slit", given={"noise": noise}) for noise in NOISES])
    write_still(opening.pixels(figure), file)
    plt.close(figure)


def page() -> str:
    """Return docs/gallery.md: every scene with its sentence and its pictures."""
    parts = [HEAD]
    for name in scene_names():
        known = load(name)
        parts.append(
            f"\n## {name}\n\n{known.about}\n\n![{name}](gallery/{name}.webp) ![{name}](gallery/{name}-drive.webp)\n"
        )
    return "".join(parts)


def write_still(picture: np.ndarray, file: Path) -> None:
    """A still as WebP, whole or not at all."""
    from PIL import Image

    with replaced(file, "-o") as stream:
        Image.fromarray(picture).save(stream, "webp", quality=72, method=6)


def write_loop(
    pictures: Sequence[np.ndarray], file: Path, *, size: tuple[int, int] | None = None, quality: int = 40
) -> None:
    """An animated WebP that starts over, whole or not at all."""
    from PIL import Image

    images = [Image.fromarray(picture).resize(size or LOOP, Image.Resampling.LANCZOS) for picture in pictures]
    durations = [round(1000 * SECONDS / len(images))] * (len(images) - 1) + [PAUSE]
    buffer = io.BytesIO()  # the library seeks in what it writes
    images[0].save(
        buffer, "webp", save_all=True, append_images=images[1:], duration=durations, loop=0, quality=quality, method=4
    )
    with replaced(file, "-o") as stream:
        stream.write(buffer.getvalue())


def main(words: Sequence[str] | None = None) -> int:
    """Make the pictures; the exit status is 2 for bad input."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "scenes", nargs="*", metavar="SCENE", help=f"built-in scenes, {', '.join(PAIRS)} or {VALUE} (all, and the page)"
    )
    parser.add_argument("-o", "--output", type=Path, default=FOLDER, metavar="DIR", help="folder (docs/gallery)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of trees, samples and drives (0)")
    parser.add_argument("--shots", type=int, default=SHOTS, metavar="N", help=f"pictures of a loop ({SHOTS})")
    parser.add_argument("--max-time", type=float, metavar="S", help="of a drive (the scene's own)")
    try:
        options = parser.parse_args(words)
        options.output.mkdir(parents=True, exist_ok=True)
        given = {"seed": options.seed, "max_time": options.max_time}
        for name in tqdm(options.scenes or (*PAIRS, VALUE, *scene_names()), desc="gallery", leave=False, disable=None):
            if name in PAIRS:
                side_by_side(PAIRS[name], options.output / f"{name}.webp", given, max(2, options.shots))
                continue
            if name == VALUE:
                value_map(options.output / f"{VALUE}.webp")
                continue
            film, time = drive(name, given)
            write_still(film.shots([MOMENT * time])[0], options.output / f"{name}.webp")
            moments = np.linspace(0.0, time, max(2, options.shots)).tolist()
            write_loop(film.shots(moments), options.output / f"{name}-drive.webp")
            film.close()
            print(f"{name}: {time:.1f} s", flush=True)
        if not options.scenes:
            with replaced(options.output.parent / "gallery.md", "-o") as stream:
                stream.write(page().encode())
    except PirrhtError as error:
        print(f"gallery.py: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
