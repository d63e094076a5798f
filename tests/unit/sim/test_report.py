"""A report tells of a sweep what a person would count by hand, and says plainly what is significant."""

import json
import re
import sys
from html.parser import HTMLParser
from itertools import product
from math import comb

import numpy as np
import pytest
import sweep_samples

from sim.cli import main
from sim.report import rendering, summary
from sim.report.summary import ALL, holm, mcnemar, mean, paired_shares, report, sign_flips, wilson
from sim.sweeps.dataset import Dataset

ASKED = {"methods": ["pi-rrht", "passive", "optimal"], "noise": {"slit": [0.1]}, "seeds": [0, 40]}
SETTINGS = {"samples": 50, "plan_seed": 0}


def record(method: str, seed: int, outcome: str | None = "goal", cost: float = 8.0, **changes) -> dict:
    known = {"scene_digest": "01", "method": method, "outcome": outcome, "cost": cost, "path_length": 4.0, "time": 5.0}
    known |= {"class_switches": seed % 2, "class_reversals": int(seed % 4 == 1), "steps": 10, "deadline_misses": 0}
    known["executed_class"] = ("0,0" if seed % 4 else "0,1") if outcome == "goal" else None
    known |= {"step_ms": {"median": 2.0, "p95": 3.0, "max": 9.0}, "plan_seconds": 1.0, "drive_seconds": 1.0}
    return sweep_samples.record(seed, **known | changes)


def stored(folder, records: list[dict], asked: dict = ASKED) -> Dataset:
    dataset = Dataset(folder)
    dataset.begin(SETTINGS, dict.fromkeys(asked["noise"], "01"), asked)
    for one in records:
        dataset.add(one)
    dataset.flush()
    return dataset


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    """40 seeds: passive fails where the seed is no multiple of 4; pi-rrht costs a tenth more than the optimum."""
    records = []
    for seed in range(40):
        records.append(record("pi-rrht", seed, cost=1.1 * (8.0 + 0.1 * seed)))
        records.append(record("optimal", seed, cost=8.0 + 0.1 * seed))
        records.append(record("passive", seed, "goal" if seed % 4 == 0 else ("collision", "timeout")[seed % 2]))
    records[0] |= {"outcome": None, "error": "ValueError: a | b"}
    return stored(tmp_path / "sweep", records)


def test_shares_means_and_classes_are_those_that_one_counts_and_costs_are_compared_on_equal_seeds(dataset):
    points = {point["method"]: point for point in report(dataset)["points"]}
    assert list(points) == ["pi-rrht", "passive", "optimal"]
    ours, passive, optimal = points.values()
    assert (ours["runs"], ours["errors"]) == (39, 1)
    assert [passive[name]["value"] for name in ("success", "collision", "timeout")] == [0.25, 0.25, 0.5]
    assert optimal["classes"]["0,0"]["value"] == 0.75
    assert (optimal["class_switches"]["value"], optimal["class_reversals"]["value"]) == (0.5, 0.25)
    assert optimal["cost"]["value"] == pytest.approx(8.0 + 0.1 * 19.5)
    for point in points.values():
        assert point["success"]["low"] <= point["success"]["value"] <= point["success"]["high"]
        assert sum(share["value"] for share in point["classes"].values()) == pytest.approx(1.0)
    assert ours["cost_over_optimal"] == pytest.approx({"value": 1.1, "low": 1.1, "high": 1.1})
    assert optimal["cost_over_optimal"]["value"] == 1.0
    best = [8.0 + 0.1 * seed for seed in range(0, 40, 4)]
    assert passive["cost_over_optimal"]["value"] == pytest.approx(8.0 * len(best) / sum(best))


def test_methods_are_compared_on_the_seeds_that_both_ended_with_and_only_what_is_significant_is_said(dataset, tmp_path):
    known = report(dataset)
    passive, optimal = known["comparisons"]
    assert (passive["method"], optimal["method"]) == ("passive", "optimal")
    assert (passive["pairs"], passive["gained"], passive["lost"], passive["arrived"]) == (39, 0, 30, 9)
    assert passive["success"]["value"] == pytest.approx(-30 / 39)
    assert passive["success_p"] == pytest.approx(2 * 0.5**30)
    assert passive["success_adjusted"] == pytest.approx(4 * passive["success_p"])
    assert (optimal["pairs"], optimal["gained"], optimal["lost"], optimal["success_p"]) == (39, 0, 0, 1.0)
    assert optimal["cost"]["value"] == pytest.approx(-0.1 * (8.0 + 0.1 * 20))
    assert optimal["cost"]["high"] < 0.0
    told = " ".join(known["findings"])
    assert "passive reaches the goal less often than pi-rrht, by 76.9 points (0 seeds gained, 30 lost" in told
    assert "optimal costs less than pi-rrht where both arrive" in told
    assert "optimal reaches the goal" not in told
    same = [record(method, seed, cost=8.0 + (seed % 3)) for method in ("pi-rrht", "single") for seed in range(9)]
    assert report(stored(tmp_path / "same", same))["findings"] == []


def test_several_scenes_are_also_told_of_together_and_paired_within_each(tmp_path):
    asked = {"methods": ["pi-rrht", "single"], "noise": {"a": [0.1], "b": [0.1]}, "seeds": [0, 3]}
    records = [
        record(method, seed, "goal" if scene == "a" or method == "pi-rrht" else "collision", scene=scene)
        for scene, method, seed in product("ab", asked["methods"], range(3))
    ]
    known = report(stored(tmp_path / "two", records, asked))
    assert list(dict.fromkeys(p["scene"] for p in known["points"])) == ["a", "b", ALL]
    told = [(c["scene"], c["pairs"], c["lost"]) for c in known["comparisons"]]
    assert told == [("a", 3, 0), ("b", 3, 3), (ALL, 6, 3)]
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
    text, html = ((dataset.folder / f"report.{ending}").read_text() for ending in ("md", "html"))
    for shown in (told, text, html):
        assert "120 of 120 runs" in shown
        assert "Significant: slit, b = 0.1: passive reaches the goal less often" in shown
        assert re.search(r"25\.0 \[14\.2, 40\.2\]", shown)
    assert "1 x ValueError: a | b" in told
    for line in text.splitlines():
        assert not line.startswith("|") or line.count("|") - line.count("\\|") in (9, 8, 11)
    page = Sources()
    page.feed(html)
    assert (page.open, len(page.found)) == ([], 5)
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in page.found)
    values = json.loads(figures.read_text())
    assert values["points"][0]["success"] == {"value": 1.0, "low": pytest.approx(0.9103, abs=1e-4), "high": 1.0}
    assert values["sweep"]["settings"] == SETTINGS


def test_without_matplotlib_the_report_has_no_pictures_and_says_so(dataset, capsys, monkeypatch):
    """It takes the place of a link."""
    (dataset.folder / "report.html").symlink_to("nowhere")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["report", str(dataset.folder)]) == 0
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "matplotlib" in told
    assert "<img" not in (dataset.folder / "report.html").read_text()
    assert not (dataset.folder / "nowhere").exists()


HOSTILE = ("$x^$", "<img src=x onerror=alert(1)>", "[a](http://example.org)", "_a_ *b* `c` | d\n# e", "\x1b[2J$")


@pytest.mark.parametrize("name", HOSTILE)
def test_names_of_scenes_methods_and_errors_are_shown_as_text_everywhere(name, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    asked = {"methods": ["pi-rrht", name], "noise": {name: [0.1]}, "seeds": [0, 2]}
    records = [record(method, seed, scene=name) for method in asked["methods"] for seed in (0, 1)]
    records[0] |= {"outcome": None, "error": f"ValueError: {name}"}
    folder = stored(tmp_path / "sweep", records, asked).folder
    assert main(["report", str(folder)]) == 0
    assert all(character.isprintable() for character in capsys.readouterr().out.replace("\n", ""))
    text, html = ((folder / f"report.{ending}").read_text() for ending in ("md", "html"))
    plain = re.sub(r"\\[^\w\s]", "", text)  # without what a backslash turns into text
    assert not re.search(r"<|`|\]\(|\*\w|\$", plain)
    assert not re.search(r"^# e", plain, re.M)
    assert {row.count("|") for row in [line for line in plain.splitlines() if line.startswith("|")]} == {7, 9, 11}
    page = Sources()
    page.feed(html)
    assert page.open == []
    assert all(source.startswith("data:image/png;base64,") for source in page.found)


def test_many_noise_levels_share_the_pictures_and_too_many_are_refused(tmp_path, refused, monkeypatch):
    pytest.importorskip("matplotlib")
    noises = [0.01 * (k + 1) for k in range(60)]
    records = [record("pi-rrht", 0, noise=noise) for noise in noises]
    dataset = stored(tmp_path / "sweep", records, {"methods": ["pi-rrht"], "noise": {"slit": noises}, "seeds": [0, 1]})
    drawn = rendering.pictures(report(dataset))
    assert drawn
    assert all("(24 of 60 rows of the tables)" in what for what in drawn)
    assert rendering.markdown(report(dataset)).count("| slit |") == 3 * len(noises)
    monkeypatch.setattr(summary, "MOST_POINTS", 59)
    refused(["report", str(dataset.folder)], "60 combinations of scene, noise and method, and a report at most 59")


# -- sweeps that are unfinished, empty, damaged or too small ------------------------------------------------------


def test_a_sweep_of_errors_alone_tells_how_many_there_were_of_each(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    failed = [record(method, seed, None, error="no way") for method in ("pi-rrht", "single") for seed in range(3)]
    failed[0]["error"] = "a lost wheel"
    dataset = stored(tmp_path / "sweep", failed)
    assert main(["report", str(dataset.folder)]) == 0
    told = capsys.readouterr().out
    for shown in (told, (dataset.folder / "report.md").read_text(), (dataset.folder / "report.html").read_text()):
        for line in ("6 runs ended with an error", "5 x no way", "1 x a lost wheel", "No comparison"):
            assert line in shown
        assert "<img" not in shown


@pytest.mark.parametrize(("seeds", "hopeless"), [(5, True), (6, True), (7, False)])
def test_too_few_seeds_for_any_finding_are_said_to_be_too_few(seeds, hopeless, tmp_path):
    """Two questions: twice McNemar's 2 / 2^n falls below 0.05 from n = 7 on."""
    same = [record(method, seed) for method in ("pi-rrht", "single") for seed in range(seeds)]
    known = report(stored(tmp_path / "sweep", same))
    assert known["least_p"] == pytest.approx(4 * 0.5**seeds)
    told = " ".join(rendering.findings(known))
    assert "None of 2 comparisons" in told
    assert ("It takes at least 7 pairs" in told) == hopeless


@pytest.mark.parametrize("runs", [0, 1])
def test_an_unfinished_sweep_is_reported_as_such_in_the_folder_that_is_asked_for(runs, tmp_path, capsys):
    dataset = stored(tmp_path / "sweep", [record("pi-rrht", seed) for seed in range(runs)])
    assert main(["report", str(dataset.folder), "-o", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert f"{runs} of 120 runs" in told
    assert "unfinished" in told
    assert "No comparison" in told
    assert (tmp_path / "report.md").exists()
    assert not (dataset.folder / "report.md").exists()


@pytest.mark.parametrize("damage", ["cut off", "empty", "other bytes"])
def test_a_part_that_cannot_be_read_is_named_in_one_line(damage, dataset, refused):
    part = dataset.files()[0]
    content = part.read_bytes()
    part.write_bytes({"cut off": content[:300], "empty": b"", "other bytes": bytes(b ^ 85 for b in content)}[damage])
    refused(["report", str(dataset.folder)], f"{part} cannot be read")
    assert not (dataset.folder / "report.md").exists()


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"scene": None}, "rows without scene"),
        ({"noise": None}, "rows without noise"),
        ({"outcome": "flew"}, "no usable outcome"),
        ({"cost": None}, "seed 1 has no usable cost"),
        ({"path_length": float("inf")}, "no usable path_length"),
    ],
)
def test_rows_that_no_sweep_wrote_are_refused_by_run_and_column(changes, what, tmp_path, refused):
    dataset = stored(tmp_path / "sweep", [record("pi-rrht", 0), record("pi-rrht", 1, **changes)])
    refused(["report", str(dataset.folder)], what)


# -- intervals and tests against published values, exact enumeration and their own coverage -----------------------


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilsons_interval_is_the_one_that_newcombe_tabulates(successes, runs, low, high):
    """Newcombe, Statistics in Medicine 17 (1998), table I, method 3."""
    assert wilson(successes, runs) == pytest.approx({"value": successes / runs, "low": low, "high": high}, abs=5e-5)


def test_mcnemar_is_the_two_sided_sign_test():
    for gained, lost in product(range(8), range(8)):
        n, k = gained + lost, min(gained, lost)
        exact = min(1.0, 2 * sum(comb(n, i) for i in range(k + 1)) * 0.5**n)
        assert mcnemar(gained, lost) == pytest.approx(exact)
    assert mcnemar(5, 15) == pytest.approx(0.04138947)
    assert mcnemar(0, 5000) < 1e-300


def test_the_bootstrap_of_a_mean_agrees_with_the_normal_interval():
    x = np.random.default_rng(1).normal(3.0, 2.0, 400)
    found, half = mean(x), 1.96 * x.std() / np.sqrt(len(x))
    assert found["value"] == pytest.approx(x.mean())
    assert (found["low"], found["high"]) == pytest.approx((x.mean() - half, x.mean() + half), abs=0.08 * half)
    assert mean(x) == found


@pytest.mark.slow
def test_the_bootstrap_covers_as_often_as_it_says():
    rng = np.random.default_rng(2)
    hits = [(i := mean(rng.exponential(1.0, 60)))["low"] <= 1.0 <= i["high"] for seed in range(200)]
    assert 0.88 <= np.mean(hits) <= 0.985


def test_the_difference_of_paired_shares_follows_bonett_and_price():
    """12 and 3 of 50: (13 - 4)/52 +- 1.96 sqrt((17/52 - (9/52)^2)/52)."""
    half = 1.959964 * np.sqrt((17 / 52 - (9 / 52) ** 2) / 52)
    assert paired_shares(12, 3, 50) == pytest.approx({"value": 9 / 50, "low": 9 / 52 - half, "high": 9 / 52 + half})
    assert paired_shares(50, 0, 50)["high"] == 1.0


def test_sign_flips_enumerate_few_pairs_and_draw_for_many():
    d = np.array([1.0, 2.0, -0.5, 3.0])
    sums = [abs(sum(s * x for s, x in zip(signs, d, strict=True))) for signs in product((-1, 1), repeat=4)]
    assert sign_flips(d) == np.mean([s >= abs(d.sum()) - 1e-12 for s in sums])
    assert sign_flips([]) == sign_flips([0.0, 0.0]) == sign_flips([0.4]) == 1.0
    assert sign_flips(np.random.default_rng(4).normal(1.0, 1.0, 100)) == pytest.approx(1 / 10_001)


@pytest.mark.slow
def test_p_values_of_random_sign_flips_are_uniform():
    rng = np.random.default_rng(4)
    p = [sign_flips(rng.normal(0.0, 1.0, 30), seed) for seed in range(200)]
    assert 0.01 <= np.mean(np.array(p) < 0.05) <= 0.1
    assert np.mean(p) == pytest.approx(0.5, abs=0.08)


def test_holms_adjustment_is_the_textbook_one():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert (holm([0.9, 0.8]), holm([])) == ([1.0, 1.0], [])
