"""Every scene is an environment for others; scores are records of a sweep, and nothing else gets among them."""

import subprocess
import sys
import warnings

import numpy as np
import pytest
from plants import ahead
from thoroughly import first

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from pirrht.errors import OptionError  # noqa: E402
from sim import gym  # noqa: E402
from sim.cli import main  # noqa: E402
from sim.mjcf import scene_names  # noqa: E402
from sim.sweeps import parts, runs  # noqa: E402
from sim.sweeps.dataset import Dataset  # noqa: E402


@pytest.mark.parametrize("scene", scene_names())
def test_every_scene_is_registered_and_passes_gymnasiums_own_checks(scene: str):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # unbounded spaces are meant
        check_env(gymnasium.make(gym.name_of(scene)).unwrapped)
        check_env(gymnasium.make("pirrht/Scene-v0", scene=scene, bound=2.0).unwrapped)


MOTIONS = {"0": {"obstacles": [{"name": "a", "radius": 0.4, "keys": [[0, 0, 5], [4, 0, -5]]}]}}


@pytest.mark.parametrize(
    ("name", "options"), [("Barn", {}), ("Barn", {"worlds": [[]]}), ("DynaBarn", {"worlds": MOTIONS})]
)
def test_courses_with_a_lidar_pass_gymnasiums_own_checks(name, options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        check_env(gymnasium.make(f"pirrht/{name}-v0", **options).unwrapped)


def test_a_body_that_moves_is_seen_where_it_is_now():
    env = gym.DynaBarn(MOTIONS)
    seen, _ = env.reset(seed=0)
    for _ in range(20):
        later, *_ = env.step(np.zeros(2))
    assert np.abs(later["ranges"] - seen["ranges"]).max() > 1.0
    assert env.best == pytest.approx(10.0)


def test_a_name_is_enough_to_import_us():
    script = "import gymnasium; print(gymnasium.make('sim.gym:pirrht/Slit-v0').unwrapped.job.scene)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "slit"


def test_scores_are_records_of_a_sweep():
    records = gym.score(ahead, scene="slit", noise=0.02, seeds=range(3), method="steering wheel")
    given = (("plan_seed", 0), ("vertices", 60), ("samples", 10), ("max_time", 0.02))
    job = runs.Job(scene="slit", method="single", noise=0.02, seed=0, given=given)
    sweeps = runs.drive(job, runs.grown(job)) | {"scene_digest": runs.digest(*job.place)}
    for seed, record in enumerate(records):
        assert record.keys() == sweeps.keys()
        assert all(type(record[name]) is type(sweeps[name]) for name in parts.KEY)
        assert (record["seed"], record["method"], record["outcome"]) == (seed, "steering wheel", "goal")
        assert (record["executed_class"], record["scene_digest"]) == ("0,0", sweeps["scene_digest"])
        assert parts.record_of(parts.row_of(record))["cost"] == record["cost"]


def test_wrapped_environments_and_policies_made_for_each_seed_are_scored_alike():
    wrapped = gymnasium.wrappers.RescaleAction(gym.Drive("slit", noise=0.1, bound=2.0), -1.0, 1.0)
    seen = []

    def anew(seed):
        seen.append(seed)
        return lambda x: 0.5 * ahead(x)

    one = gym.score(anew, environment=wrapped, seeds=[4, 7], method="m", anew=True)
    other = gym.score(lambda x: np.clip(ahead(x), -2, 2), scene="slit", noise=0.1, seeds=[4, 7], method="m")
    assert seen == [4, 7]
    for a, b in zip(one, other, strict=True):
        assert (a["outcome"], a["cost"]) == (b["outcome"], pytest.approx(b["cost"]))


FAST = {"scene": "slit", "noise": 0.02, "max_time": 0.05}
SWEEP = "sweep slit --noise 0.02 --seeds 0:3 --methods passive --vertices 60 --samples 10 --max-time 0.05 --jobs 1"


@pytest.fixture
def swept(tmp_path):
    assert main([*SWEEP.split(), "-o", str(tmp_path / "sweep")]) == 0
    return tmp_path / "sweep"


def mine(folder) -> dict[int, dict]:
    """Records of the method "mine" in a sweep's folder, by seed."""
    return {r["seed"]: r for r in Dataset(folder).records() if r["method"] == "mine"}


def test_a_report_shows_the_users_method_next_to_ours(swept, tmp_path, capsys):
    before = Dataset(swept).records()
    scored = gym.score(ahead, seeds=range(3), method="mine", into=swept, **FAST)
    assert Dataset(swept).records()[:3] == before
    for name in ("cost", "noisy_path_length"):
        assert [r[name] for r in Dataset(swept).records()[3:]] == [r[name] for r in scored]
    assert main(["report", str(swept)]) == 0
    said = capsys.readouterr().out
    assert "6 of 6 runs asked for are there" in said
    assert "mine" in said
    assert main([*SWEEP.split(), "-o", str(swept)]) == 0  # it goes on as before
    gym.score(ahead, seeds=[4, 7], method="mine", into=tmp_path / "new", scene="slit", noise=0.02)
    assert main(["report", str(tmp_path / "new")]) == 0
    assert "2 of 2 runs asked for are there" in capsys.readouterr().out
    Dataset(tmp_path / "new").check({"plan_seed": 0}, {})


def test_runs_that_are_there_are_refused_and_replaced_only_on_demand_and_none_is_lost_by_a_failure(swept):
    driven = []

    def other(x):
        driven.append(x)
        return np.array([-0.5, 0.0])

    with pytest.raises(OptionError, match="seed 2"):
        gym.score(lambda seed: ahead if seed < 2 else lambda x: x * np.nan, seeds=range(5), method="mine", anew=True,
                  into=swept, **FAST)  # fmt: skip
    assert sorted(mine(swept)) == [0, 1]
    with pytest.raises(OptionError, match=r"holds 1 of these runs already \(method 'mine', seed 1\).* again=True"):
        gym.score(other, seeds=[1, 2], method="mine", into=swept, **FAST)
    assert not driven  # refused before anything is driven
    scored = gym.score(other, seeds=[1, 2], method="mine", into=swept, again=True, **FAST)
    assert [mine(swept)[seed]["cost"] for seed in (1, 2)] == [r["cost"] for r in scored]
    assert sorted(mine(swept)) == [0, 1, 2]


@pytest.mark.parametrize(
    ("changes", "what"),
    first(
        [
            ({"max_time": 0.1}, "--max-time 0.05 and these drives are with 0.1"),
            ({"plant": "sde"}, "--plant mujoco and these drives are with sde"),
            ({"phi": 5.0}, "--phi inf and these drives are with 5.0"),
            ({"start": (1.0, 2.0)}, "--start 1.0 2.5 and these drives are with 1.0 2.0"),
            ({"goal": (5.0, 2.5, 0.2)}, "--goal"),
            ({"robot": "unicycle"}, "--phi inf and"),
        ]
    ),
)
def test_runs_of_another_task_are_not_mixed_in(swept, changes, what):
    with pytest.raises(OptionError, match=rf"{what}.*choose another folder"):
        gym.score(ahead, seeds=[0], method="mine", into=swept, **{**FAST, **changes})
