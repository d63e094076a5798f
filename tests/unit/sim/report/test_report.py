"""A report tells of a sweep what a person would count by hand, and says plainly what is significant."""

import json
import re
from html.parser import HTMLParser

import pytest
from report_samples import SETTINGS, record, stored

from sim.cli import main
from sim.report.summary import ALL, report


def test_shares_means_and_classes_are_those_that_one_counts(dataset):
    points = {point["method"]: point for point in report(dataset)["points"]}
    assert list(points) == ["pi-rrht", "passive", "optimal"]
    assert (points["pi-rrht"]["runs"], points["pi-rrht"]["errors"]) == (39, 1)
    passive = points["passive"]
    assert (passive["success"]["value"], passive["collision"]["value"], passive["timeout"]["value"]) == (
        0.25,
        0.25,
        0.5,
    )
    assert points["optimal"]["classes"]["0,0"]["value"] == 0.75
    assert points["optimal"]["class_switches"]["value"] == 0.5
    assert points["optimal"]["class_reversals"]["value"] == 0.25
    assert points["optimal"]["cost"]["value"] == pytest.approx(8.0 + 0.1 * 19.5)
    for point in points.values():
        assert point["success"]["low"] <= point["success"]["value"] <= point["success"]["high"]
        assert sum(share["value"] for share in point["classes"].values()) == pytest.approx(1.0)


def test_cost_over_optimal_is_taken_on_equal_seeds(dataset):
    points = {point["method"]: point for point in report(dataset)["points"]}
    assert points["pi-rrht"]["cost_over_optimal"]["value"] == pytest.approx(1.1)
    assert points["pi-rrht"]["cost_over_optimal"]["high"] == pytest.approx(1.1)
    assert points["optimal"]["cost_over_optimal"]["value"] == 1.0
    best = [8.0 + 0.1 * seed for seed in range(0, 40, 4)]
    assert points["passive"]["cost_over_optimal"]["value"] == pytest.approx(8.0 * len(best) / sum(best))


def test_methods_are_compared_on_the_seeds_that_both_have_come_to_an_end_with(dataset):
    known = {c["method"]: c for c in report(dataset)["comparisons"]}
    assert list(known) == ["passive", "optimal"]
    passive, optimal = known["passive"], known["optimal"]
    assert (passive["pairs"], passive["gained"], passive["lost"], passive["arrived"]) == (39, 0, 30, 9)
    assert passive["success"]["value"] == pytest.approx(-30 / 39)
    assert passive["success_p"] == pytest.approx(2 * 0.5**30)
    assert passive["success_adjusted"] == pytest.approx(4 * passive["success_p"])
    assert (optimal["pairs"], optimal["gained"], optimal["lost"], optimal["success_p"]) == (39, 0, 0, 1.0)
    assert optimal["cost"]["value"] == pytest.approx(-0.1 * (8.0 + 0.1 * 20))
    assert optimal["cost"]["high"] < 0.0


def test_what_is_significant_is_said_and_nothing_else(dataset, tmp_path):
    told = " ".join(report(dataset)["findings"])
    assert "passive reaches the goal less often than pi-rrht, by 76.9 points (0 seeds gained, 30 lost" in told
    assert "optimal costs less than pi-rrht where both arrive" in told
    assert "optimal reaches the goal" not in told
    same = [record(method, seed, cost=8.0 + (seed % 3)) for method in ("pi-rrht", "single") for seed in range(9)]
    assert report(stored(tmp_path / "same", same))["findings"] == []


def test_several_scenes_are_also_told_of_together_and_paired_within_each(tmp_path):
    asked = {"methods": ["pi-rrht", "single"], "noise": {"a": [0.1], "b": [0.1]}, "seeds": [0, 3]}
    records = [
        record(method, seed, "goal" if scene == "a" or method == "pi-rrht" else "collision", scene=scene)
        for scene in "ab"
        for method in ("pi-rrht", "single")
        for seed in range(3)
    ]
    known = report(stored(tmp_path / "two", records, asked))
    assert list(dict.fromkeys(p["scene"] for p in known["points"])) == ["a", "b", ALL]
    assert [(c["scene"], c["pairs"], c["lost"]) for c in known["comparisons"]] == [
        ("a", 3, 0),
        ("b", 3, 3),
        (ALL, 6, 3),
    ]
    assert next(p for p in known["points"] if p["scene"] == ALL)["runs"] == 6


class Sources(HTMLParser):
    """Everything that a page would load, and whether its elements are closed."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_command_prints_and_writes_all_of_it_and_the_page_loads_nothing(dataset, capsys):
    pytest.importorskip("matplotlib")
    figures = dataset.folder / "figures.json"
    assert main(["report", str(dataset.folder), "--json", str(figures)]) == 0
    told = capsys.readouterr().out
    text = (dataset.folder / "report.md").read_text()
    html = (dataset.folder / "report.html").read_text()
    for shown in (told, text, html):
        assert "120 of 120 runs" in shown
        assert "Significant: slit, b = 0.1: passive reaches the goal less often" in shown
        assert re.search(r"25\.0 \[14\.2, 40\.2\]", shown)
    assert "1 x ValueError: a | b" in told
    for line in text.splitlines():
        assert not line.startswith("|") or line.count("|") - line.count("\\|") in (9, 8, 11)
    page = Sources()
    page.feed(html)
    assert page.open == []
    assert len(page.found) == 5
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in page.found)
    values = json.loads(figures.read_text())
    assert values["points"][0]["success"] == {"value": 1.0, "low": pytest.approx(0.9103, abs=1e-4), "high": 1.0}
    assert values["sweep"]["settings"] == SETTINGS


def test_without_matplotlib_the_report_has_no_pictures_and_says_so(dataset, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    assert main(["report", str(dataset.folder)]) == 0
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "matplotlib" in told
    assert "<img" not in (dataset.folder / "report.html").read_text()
