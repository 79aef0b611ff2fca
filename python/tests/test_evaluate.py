"""`evaluate` against the command line, against single rooms, and against mistakes."""

from __future__ import annotations

import copy
import json
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, seek

import jostle


@pytest.mark.parametrize("crowd", ["NH", "SO", "SF"])
def test_a_policy_through_python_is_the_policy_on_the_command_line(
    crowd: str, pool: Path, xtask: Callable[..., str], tmp_path: Path
) -> None:
    run = pool / "run1"
    xtask("evaluate", run, "--crowds", crowd, "--episodes", 12, "--seed", 3, "--pool", pool, "--out", tmp_path)
    (report,) = tmp_path.glob("*.json")
    (cell,) = json.loads(report.read_text())["cells"]
    (records,) = (tmp_path / "records").glob("*.ndjson")
    expected = [json.loads(line) for line in records.read_text().splitlines()]

    policy = jostle.Policy(run)
    keywords = {"crowd": crowd, "episodes": 12, "seed": 3, "pool": pool}
    native = jostle.evaluate(policy, **keywords)
    through_python = jostle.evaluate(lambda rows: policy(rows), **keywords)
    assert native.records == expected
    for found in (native, through_python):
        summary = cell["summary"]
        assert found.n_agents == 5
        for key in ("episodes", "success", "collision_wall", "collision_pedestrian", "timeout", "success_rate"):
            assert getattr(found, key) == summary[key]
        assert found.wilson_95 == (summary["wilson_95"]["low"], summary["wilson_95"]["high"])
        for key in ("extra_time", "extra_distance", "average_speed"):
            assert getattr(found, key) == (summary[key]["mean"], summary[key]["std"])
        assert found.driving == cell["driving"]
        assert 0 < found.driving["min_clearance_tail"] <= found.driving["min_clearance"]
        # The function has another name than the policy's file, and so another cell and provenance.
        what = expected[0].keys() - {"cell", "provenance"}
        assert {"outcome", "steps", "start", "goal", "path_length", "driving"} <= what
        assert [[r[key] for key in what] for r in found.records] == [[r[key] for key in what] for r in expected]


@pytest.mark.parametrize("crowd", ["VO", "SF"])
def test_a_room_goes_through_the_episodes_of_the_test(crowd: str) -> None:
    found = jostle.evaluate(seek, crowd, episodes=10, seed=2)
    assert found.success + found.collision_wall + found.collision_pedestrian + found.timeout == 10
    assert found.success > 0
    env = jostle.RoomEnv(crowd)
    for record in found.records:
        observation, _ = env.reset(seed=2, options={"test_episode": record["episode"]})
        ended = False
        while not ended:
            observation, _, terminated, truncated, info = env.step(seek(observation[None])[0])
            ended = terminated or truncated
        assert (info["outcome"], info["steps"]) == (record["outcome"], record["steps"])
        assert info["path_length"] == record["path_length"]


def test_training_never_meets_the_tests_episodes() -> None:
    env = jostle.RoomEnv("SF")
    training = [tuple(env.reset(seed=seed)[0][-4:-2]) for seed in range(5)]
    test = [tuple(env.reset(seed=s, options={"test_episode": k})[0][-4:-2]) for s in range(5) for k in range(5)]
    assert not set(training) & set(test)


def test_the_batch_changes_nothing_but_speed() -> None:
    few = jostle.evaluate(seek, "VO", episodes=9, batch=2)
    sizes = []

    def watched(rows: np.ndarray) -> np.ndarray:
        sizes.append(len(rows))
        return seek(rows)

    many = jostle.evaluate(watched, "VO", episodes=9, name="seek")
    # `name` and records are all that an evaluation holds beside the figures.
    assert few == many
    assert sizes[0] == 9 and sizes[-1] == 1


def test_every_call_gets_the_same_memory() -> None:
    where = set()

    def watched(rows: np.ndarray) -> np.ndarray:
        assert rows.dtype == np.float32 and rows.flags.c_contiguous
        where.add(rows.__array_interface__["data"][0])
        return seek(rows)

    jostle.evaluate(watched, "SF", episodes=5)
    assert len(where) == 1


@pytest.mark.parametrize(
    ("fn", "message"),
    [
        (lambda rows: np.zeros((len(rows), 3)), "actions: found shape [4, 3], expected [4, 2]"),
        (lambda rows: np.zeros((1, 2)), "actions: found shape [1, 2], expected [4, 2]"),
        (lambda rows: np.full((len(rows), 2), np.inf), "episode 0, step 0: the robot's action is (inf, inf)"),
        (lambda rows: "left", "could not convert string to float: 'left'"),
    ],
)
def test_wrong_answers_are_one_line(fn: Callable, message: str) -> None:
    with pytest.raises(ValueError) as error:
        jostle.evaluate(fn, "SF", episodes=4)
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_what_a_policy_raises_arrives(error: type[BaseException]) -> None:
    def tired(rows: np.ndarray) -> np.ndarray:
        raise error

    with pytest.raises(error):
        jostle.evaluate(tired, "SF", episodes=4)


def test_mistakes_are_one_line(pool: Path, tmp_path: Path) -> None:
    for keywords, message in [
        ({"episodes": 0}, "episodes: found 0, expected a whole number from 1 on"),
        ({"batch": 0}, "batch: found 0, expected a whole number from 1 on"),
        ({"seed": -1}, "seed: found -1, expected a whole number from 0 to"),
        ({"crowd": "SO", "pool": tmp_path}, f"{tmp_path} holds no run folder and no checkpoint"),
    ]:
        with pytest.raises(ValueError) as error:
            jostle.evaluate(seek, **keywords)
        assert str(error.value).startswith(message)
    with pytest.raises(ValueError, match="^token: found 1, expected less than the policy's 1 behaviours$"):
        jostle.Policy(pool / "run1", token=1)


def test_a_policy_answers_rows_and_single_observations(pool: Path) -> None:
    policy = jostle.Policy(pool / "run1")
    rows = np.stack([jostle.RoomEnv("SF").reset(seed=seed)[0] for seed in range(3)])
    actions = policy(rows)
    assert actions.shape == (3, 2) and np.isfinite(actions).all()
    assert (actions[:, 0] >= 0).all() and (np.abs(actions[:, 1]) <= 1).all()
    np.testing.assert_array_equal(policy(rows[1]), actions[1])
    with pytest.raises(ValueError, match=r"^observations: found shape \[1, 3\], expected rows of 1540$"):
        policy(np.zeros(3))
    for other in (copy.deepcopy(policy), pickle.loads(pickle.dumps(policy))):
        np.testing.assert_array_equal(other(rows), actions)
        assert (other.name, other.token) == ("run1", 0)


def test_so_never_takes_the_full_policy_for_the_half_trained_one(pool: Path, tmp_path: Path) -> None:
    """Where a run has not kept it, and for a file outside a run: refused as on the command line, until it is named."""
    lost = tmp_path / "lost"
    shutil.copytree(pool / "run1", lost)
    (lost / "checkpoints/000002.safetensors").unlink()
    file = tmp_path / "000004.safetensors"
    shutil.copy(pool / "run1/checkpoints/000004.safetensors", file)
    for wrong, message in [
        (lost, f"crowd SO needs {lost}/checkpoints/000002.safetensors, which is not there; name another with pool_half"),
        (file, f"crowd SO needs half-trained policies, and {file} is no run's checkpoint; name them with pool_half"),
    ]:
        for make in (lambda **words: jostle.evaluate(seek, episodes=2, **words), jostle.RoomEnv, jostle.VectorRooms):
            with pytest.raises(ValueError) as error:
                make(crowd="SO", pool=wrong)
            assert str(error.value) == message
    half = pool / "run1/checkpoints/000002.safetensors"
    named = jostle.evaluate(seek, "SO", episodes=4, pool=file, pool_half=half)
    found = jostle.evaluate(seek, "SO", episodes=4, pool=pool / "run1")
    assert named.records == found.records
    full = jostle.evaluate(seek, "SO", episodes=4, pool=file, pool_half=file)
    assert [r["cell"] for r in full.records] != [r["cell"] for r in found.records]


def test_a_policy_refuses_numbers_that_are_none(pool: Path) -> None:
    policy = jostle.Policy(pool / "run1")
    rows = np.stack([jostle.RoomEnv("SF").reset(seed=seed)[0] for seed in range(3)])
    for row, entry, value, name in [
        (0, 1536, np.nan, "goal x"),
        (2, 1537, np.inf, "goal y"),
        (1, 1538, -np.inf, "v"),
        (1, 1539, np.nan, "ω"),
        (2, 700, np.inf, "a range"),
        (0, 0, np.nan, "a range"),
    ]:
        wrong = rows.copy()
        wrong[row, entry] = value
        with pytest.raises(ValueError) as error:
            policy(wrong)
        shown = "NaN" if np.isnan(value) else f"{value}"
        expected = f"observations: found {shown} in row {row}, entry {entry} ({name}), expected finite numbers"
        assert str(error.value).startswith(expected)
        with pytest.raises(ValueError, match=f"in row 0, entry {entry}"):
            policy(wrong[row])
    with pytest.raises(ValueError, match="found inf in row 0, entry 1536"):
        policy(np.where(np.arange(1540) == 1536, 1e300, 0.0))


def test_a_policy_that_is_not_there_is_answered_with_the_nearest(pool: Path) -> None:
    with pytest.raises(ValueError) as error:
        jostle.Policy(pool / "run")
    assert str(error.value) == (
        f"{pool}/run: found no such file or folder, expected a checkpoint file or a run folder; "
        f"did you mean {pool}/run1 or {pool}/run2?"
    )


SAMPLE = ROOT / "recordings" / "sample.txt"


def test_recorded_people_are_those_of_the_command_line(xtask: Callable[..., str], tmp_path: Path) -> None:
    words = ("evaluate", "goal-seeker", "--recording", SAMPLE, "--episodes", 8, "--seed", 1, "--out", tmp_path)
    xtask(*words)
    (records,) = (tmp_path / "records").glob("recorded-*.ndjson")
    expected = [json.loads(line) for line in records.read_text().splitlines()]
    found = jostle.evaluate(jostle.planner("goal-seeker"), "recorded", recording=SAMPLE, episodes=8, seed=1)
    assert found.records == expected
    assert found.crowd == "recorded" and found.n_agents > 5
    env = jostle.RoomEnv("recorded", recording=SAMPLE)
    _, info = env.reset(seed=1, options={"test_episode": 3})
    assert tuple(info["goal"]) == tuple(np.float32(expected[3]["goal"]))
    people = env.state()["pedestrians"]
    assert 1 <= len(people) < found.n_agents and np.abs(people[:, :2]).max() < 10
    again = pickle.loads(pickle.dumps(env))
    for _ in range(5):
        a, b = env.step([0.5, 0.1]), again.step([0.5, 0.1])
        assert a[0].tobytes() == b[0].tobytes()


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"recording": SAMPLE}, f"recording: found {SAMPLE} for crowd SF, expected it for crowd recorded only"),
        ({"crowd": "recorded"}, "recording: found none, expected people to play back (crowd recorded)"),
        (
            {"crowd": "recorded", "recording": SAMPLE, "n_pedestrians": 3},
            "n_pedestrians: found 3, expected None: the recording says who is there",
        ),
        (
            {"crowd": "recorded", "recording": SAMPLE, "recording_interval": "fast"},
            "recording_interval: found 'fast', expected a number of seconds or None",
        ),
        ({"recording_gap": 1.0}, "recording_gap: found 1.0, expected None without a recording"),
    ],
)
def test_what_does_not_fit_a_recording_is_refused(keywords: dict, message: str) -> None:
    with pytest.raises(ValueError) as error:
        jostle.evaluate(seek, episodes=1, **keywords)
    assert str(error.value) == message
