"""A recording as a table: every column is described, holds what the frames held, and survives a broken recording."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from drives import Drive

from pirrht import collision_probability
from sim.cli import main
from sim.drive.metrics import Truth
from sim.recording import export

FAKE = Truth(value=9.0, control=np.array([0.5, -0.5]))


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    file, drive = tmp_path_factory.mktemp("export") / "slit.rrd", Drive()
    with drive.recorder(file, truth=True) as recorder:
        frames, problem = [], drive.controller.problem
        for frame in drive.frames(risk=lambda plan: collision_probability(problem, plan.estimate, step=0.002)):
            frames.append(replace(frame, truth=FAKE))
            recorder.log(frames[-1])
    return file, frames


@pytest.fixture(scope="module")
def table(drive):
    return export.table(export.read(drive[0]))


def test_columns_hold_what_the_frames_held(drive, table):
    frames = drive[1]
    estimates = [frame.plan.estimate for frame in frames]

    def same(names, values):
        np.testing.assert_array_equal(np.column_stack([table[name] for name in names.split()]).squeeze(), values)

    same("step", [f.step for f in frames])
    np.testing.assert_allclose(table["time"], [f.time for f in frames], atol=2e-6)
    same("duration", [f.advance.time for f in frames])
    same("x y", [f.plan.state for f in frames])
    same("end_x end_y", [f.state for f in frames])
    same("control_1 control_2", [f.plan.control for f in frames])
    same("noise_1 noise_2", [f.advance.noise.sum(axis=0) for f in frames])
    same("cost length", [(f.cost, f.length) for f in frames])
    same("vertices", [f.vertices for f in frames])
    same("clearance", [f.clearance for f in frames])
    assert 0.0 < table["collision"][0] < 0.1
    same("collision collision_error", [(f.collision.probability, f.collision.error) for f in frames])
    same("value value_error", [(e.value, e.value_error) for e in estimates])
    same("control_error_1 control_error_2", [e.control_error for e in estimates])
    same("exact_value exact_control_1 exact_control_2", [(9.0, 0.5, -0.5)] * len(frames))
    np.testing.assert_allclose(table["plan_ms"], [1e3 * f.plan_seconds for f in frames])
    assert list(table["outcome"]) == [""] * (len(frames) - 1) + ["timeout"]
    for name in {name for e in estimates for name in e.class_weights}:
        same(f"weight:{name}", [e.class_weights.get(name, 0.0) for e in estimates])
        same(f"ess:{name}", [e.class_ess.get(name, 0.0) for e in estimates])


def test_both_formats_hold_the_same_columns_with_units_and_settings(drive, table, tmp_path):
    for name in ("a.parquet", "a.npz"):
        assert main(["export", str(drive[0]), "-o", str(tmp_path / name)]) == 0
    parquet, packed = pq.read_table(tmp_path / "a.parquet"), np.load(tmp_path / "a.npz")
    about = json.loads(str(packed["about"]))
    assert parquet.column_names == list(table) == list(about["columns"]) == packed.files[:-1]
    for name, values in table.items():
        field = parquet.schema.field(name)
        assert field.metadata[b"unit"].decode() == about["columns"][name]["unit"]
        assert field.metadata[b"description"].decode() == about["columns"][name]["text"] != ""
        np.testing.assert_array_equal(parquet.column(name).to_numpy(), values)
        np.testing.assert_array_equal(packed[name], values)
    units = {"control_2": "m/s, m/s^2 or 1", "end_y": "m", "ess:other": "1", "value": "cost", "outcome": ""}
    assert units.items() <= {name: one["unit"] for name, one in about["columns"].items()}.items()
    assert json.loads(parquet.schema.metadata[b"pirrht"]) == about["settings"]
    assert (about["settings"]["scene"], about["settings"]["seed"]) == ("slit", 0)


@pytest.mark.parametrize("share", [0.45, 0.99])
def test_of_a_recording_that_breaks_off_the_whole_chunks_are_exported(drive, table, tmp_path, capsys, share):
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(drive[0].read_bytes()[: int(share * drive[0].stat().st_size)])
    assert main(["export", str(cut), "-o", str(tmp_path / "a.npz")]) == 0
    said, packed = capsys.readouterr().out, np.load(tmp_path / "a.npz")
    count = len(packed["step"])
    assert count > 0
    assert ("without an outcome" in said) == (count < len(table["step"]))
    for name in packed.files[:-1]:
        end = count - 1 if name.startswith("end_") else count
        np.testing.assert_array_equal(packed[name][:end], table[name][:end])


@pytest.fixture
def folder(tmp_path, monkeypatch, drive):
    (tmp_path / "start.rrd").write_bytes(drive[0].read_bytes()[:60_000])
    (tmp_path / "whole.rrd").write_bytes(drive[0].read_bytes())
    (tmp_path / "empty.rrd").touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("typed", "reason"),
    [
        ("none.rrd -o a.npz", "does not exist"),
        (". -o a.npz", "a folder"),
        ("empty.rrd -o a.npz", "no Rerun recording"),
        ("start.rrd -o a.npz", "holds no"),
        ("whole.rrd -o a.csv", ".parquet, .npz"),
        ("whole.rrd -o no/a.npz", "does not exist"),
        ("whole.rrd", "-o"),
    ],
)
def test_wrong_input_costs_one_line(folder, refused, typed, reason):
    before = sorted(folder.iterdir())
    refused(["export", *typed.split()], reason)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("ids", "titles"),
    [
        (["0,0,0,0,1,0,0,0,0,0,0,1", "0,0,0,-1,0,0,0,0,0,0,0,0", "other"], ["+5 +12", "-4", "other"]),
        (["0,1", "-1,0"], ["0,1", "-1,0"]),
    ],
)
def test_columns_of_classes_bear_the_titles_of_tables_and_keep_the_whole_id_beside(tmp_path, ids, titles):
    cells = {"classes": ids, "weights": [0.5, 0.3, 0.2][: len(ids)], "ess": [5.0, 3.0, 2.0][: len(ids)]}
    known = export.Recording(settings={}, steps=[(0, 0.0, {**cells, "state": [1.0, 2.0]})], plan_ms={})
    table = export.table(known)
    assert [name for name in table if name.startswith(("weight:", "ess:"))] == [
        f"{kind}:{title}" for kind in ("weight", "ess") for title in titles
    ]
    for name in ("a.parquet", "a.npz"):
        export.write(tmp_path / name, table, known)
    schema, about = pq.read_schema(tmp_path / "a.parquet"), json.loads(str(np.load(tmp_path / "a.npz")["about"]))
    for title, whole in zip(titles, ids, strict=True):
        assert schema.field(f"weight:{title}").metadata[b"class"].decode() == whole
        assert about["columns"][f"ess:{title}"]["class"] == whole


@pytest.mark.parametrize(
    ("states", "names"),
    [
        ("x y vx vy", ["x", "y", "vx", "vy"]),
        ("x y vy heading vx", ["x", "y", "heading", "vx", "vy"]),
        ("x y surge heading", ["x", "y", "heading", "state_3"]),
    ],
)
def test_states_are_columns_by_their_names_wherever_they_stand(states, names):
    order = states.split()
    row = {"state": [float(k) for k in range(len(order))], "end": [10.0 + k for k in range(len(order))]}
    table = export.table(export.Recording(settings={"states": states}, steps=[(0, 0.0, row)], plan_ms={}))
    assert [n for n in table if n in names or n.startswith("state_")] == names
    for name in names:
        at = order.index(name) if name in order else int(name.removeprefix("state_")) - 1
        assert (table[name], table[f"end_{name}"]) == (float(at), 10.0 + at)
