"""The figures of the paper: made whole, with units on axes, the colours of recordings, and bodies where they are."""

import subprocess
import sys

import numpy as np
import pytest
from discs import disc
from figures import braids, gallery, lifted, snapshots, style
from figures.effort import Effort
from matplotlib.colors import to_hex
from moving import moved
from repository import ROOT
from thoroughly import first

from pirrht.plotting import maps
from pirrht.plotting.colors import ClassColors
from pirrht.plotting.strokes import outline
from pirrht.plotting.tuning import TUNING as PLOTTING
from sim.drawing import strokes
from sim.drawing.colors import title
from sim.mjcf import load

SCRIPT = ROOT / "scripts" / "reproduce_figures.py"
SMALL = Effort(vertices=250, samples=30, max_time=0.15, noises=(0.05, 0.3), draws=100, estimates=2, paths=20)
plt = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(scope="module")
def tree():
    return lifted.work(SMALL, lambda: None)


@pytest.fixture(scope="module")
def drive():
    return snapshots.drive(SMALL.scenario("slit", noise=0.3), (0.0, 0.5))


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def colored(axes):
    """Colours of the lines of an axes."""
    return [line.get_color() for line in axes.get_lines()]


def palette(ids):
    colors = ClassColors(ids)
    return [style.rgb(colors[name]) for name in ids]


@pytest.mark.parametrize("number", gallery.FIGURES)
def test_every_figure_is_a_file_and_tells_each_piece_of_its_work(number, tmp_path):
    done, open_before = list[int](), plt.get_fignums()  # of other tests in this process
    file = gallery.make(number, tmp_path, "png", SMALL, lambda: done.append(1))
    assert [path.name for path in tmp_path.iterdir()] == [f"{gallery.FIGURES[number].name}.png"]
    assert file.read_bytes().startswith(b"\x89PNG")
    assert len(done) == gallery.FIGURES[number].pieces(SMALL)
    assert plt.get_fignums() == open_before


@pytest.mark.parametrize("format", style.FORMATS)
def test_a_seed_means_a_file(format, tmp_path, tree):
    files = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        with plt.rc_context(style.RULES):
            style.save(lifted.draw(plt, tree), style.check(folder, "tree", format))
        files.append((folder / f"tree.{format}").read_bytes())
    assert files[0] == files[1]


def test_the_lifted_tree_has_a_panel_per_obstacle_and_a_path_per_class(tree):
    figure = lifted.draw(plt, tree)
    ids = [reference.id for reference in tree.references]
    assert len(figure.axes) == len(tree.scenario.space.obstacles) == 2
    told = [text.get_text() for text in figure.legends[0].get_texts() if text.get_text().startswith("class")]
    assert told == [f"class {title(r.id)}: cost {r.cost:.2f}" for r in tree.references]
    for k, axes in enumerate(figure.axes):
        assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()) == (
            "$x$ [m]",
            "$y$ [m]",
            f"$H_{k + 1}$ [turns]",
        )
        assert all(colored(axes).count(color) == 1 for color in palette(ids))


def test_a_snapshot_has_a_reference_per_class_in_its_colour_and_weights_that_fill_its_bar(drive):
    figure = snapshots.draw(plt, [drive], labels=["$b$ = 0.3, "], width=7.0, whole=False)
    assert len(figure.axes) == len(drive.shown) == 2
    for axes, step in zip(figure.axes, drive.shown, strict=True):
        plan = drive.frames[step].plan
        assert [color for color in colored(axes) if color in palette(plan.ids)] == palette(plan.ids)[::-1]
        bar = [patch for patch in axes.patches if patch.get_zorder() == 12]
        assert sum(patch.get_width() for patch in bar) == pytest.approx(1.0)
        assert (axes.get_aspect(), axes.get_xlabel()) == (1.0, "$x$ [m]")
    assert figure.axes[0].get_ylabel() == "$y$ [m]"
    assert figure.axes[1].get_title(loc="left") == f"(b) $b$ = 0.3, $t$ = {drive.frames[drive.shown[1]].time:.1f} s"


def test_a_snapshot_shows_the_body_where_it_is_then_and_where_the_plan_takes_it():
    one = snapshots.drive(SMALL.scenario("crossing"), (0.0, 1.0))
    figure = snapshots.draw(plt, [one], labels=[""], width=7.0, whole=True)
    (mover,) = load("crossing").scene.movers
    for axes, step in zip(figure.axes, one.shown, strict=True):
        (body,) = [p for p in axes.patches if p.get_fill() and to_hex(p.get_facecolor()) == maps.MOVER]
        (solid,) = mover.at(one.frames[step].time)
        np.testing.assert_allclose(body.get_xy()[:-1], outline(solid))
        later = [p for p in axes.patches if not p.get_fill() and to_hex(p.get_edgecolor()) == maps.MOVER]
        assert len(later) == len(PLOTTING.moments)


def test_a_panel_per_scene_has_a_braid_per_class_up_to_its_end():
    shown = braids.work(SMALL, lambda: None)
    figure = braids.draw(plt, shown)
    assert len(figure.axes) == len(braids.SCENES) == len(shown)
    for axes, one in zip(figure.axes, shown, strict=True):
        assert [axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()] == ["$x$ [m]", "$y$ [m]", "$t$ [s]"]
        assert len(one.references) >= 2
        assert axes.get_zlim()[1] >= max(strokes.timed(reference, 0.0)[-1, 2] for reference in one.references)
        told = " ".join(text.get_text() for text in axes.texts)
        assert all(f"{reference.cost:.2f}" in told for reference in one.references)


def test_what_lies_behind_a_tube_is_hidden_and_what_lies_before_it_is_not():
    (tube,) = strokes.tubes(moved("m", [(0, 3, 3, 0)], disc("d", 0, 0, 0.3)), 0.0, 5.0)
    towards = braids._towards_eye(5.0)
    for off, behind in ((-1.0, True), (-0.5, True), (0.5, False), (1.0, False)):
        assert bool(braids.hidden((np.array([3.0, 3.0, 2.0]) + off * towards)[None], [tube], 5.0)[0]) is behind
    assert not braids.hidden(np.array([[1.0, 3.0, 2.0], [3.0, 4.0, 4.9]]), [tube], 5.0).any()


def script(*arguments, **options):
    return subprocess.run(
        [sys.executable, str(SCRIPT), *arguments], capture_output=True, text=True, timeout=120, **options
    )


@pytest.mark.parametrize(
    ("arguments", "told"),
    first(
        [
            (["--only", "9"], "--only: there is no figure '9'; name some of 1,2,3,4,5"),
            (["--only", ""], "--only: there is no figure ''"),
            (["--format", "gif"], "gif"),
            (["--dpi", "5"], "from 50 to 1200"),
            (["-o", "/dev/null/figures"], "-o /dev/null/figures: no folder can be made there"),
            (["--seed", "-1"], "seed"),
        ]
    ),
)
def test_bad_options_are_refused_in_one_line(arguments, told, tmp_path):
    done = script(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert told in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.rglob("*.pdf"))
