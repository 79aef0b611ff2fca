"""`scan_to_row`: what a robot's own numbers become."""

from __future__ import annotations

import numpy as np
import pytest

import jostle


def test_a_row_made_by_hand_is_the_environments() -> None:
    env = jostle.RoomEnv("SF", settings={"sim.laser.noise_std": 0.0})
    observation, info = env.reset(seed=1)
    scans = [env.state()["ranges"]] * 3
    for action in ([1.0, 0.2], [0.5, -1.0], [1.0, 0.0], [0.0, 0.0]):
        scans = [*scans[1:], env.state()["ranges"]]
        row = jostle.scan_to_row(scans, observation[-4:-2], observation[-2:])
        assert row.dtype == np.float32
        np.testing.assert_array_equal(row, observation)
        observation, *_ = env.step(action)
    first, _ = env.reset(seed=2)
    row = jostle.scan_to_row(env.state()["ranges"], first[-4:-2], [0.0, 0.0])
    np.testing.assert_array_equal(row, first, err_msg="one scan fills all three")


def test_infinite_ranges_are_nothing_in_reach_and_too_near() -> None:
    row = jostle.scan_to_row([np.inf, 10.0, 99.0, -np.inf, 0.0, -1.0, 5.0], [1.0, 2.0], [0.5, 0.0])
    expected = [0.5, 0.5, 0.5, -0.5, -0.5, -0.5, 0.0]
    np.testing.assert_array_equal(row, np.array([*expected * 3, 1.0, 2.0, 0.5, 0.0], np.float32))
    assert jostle.scan_to_row([np.inf, 2.0], [0, 0], [0, 0], max_range=4.0)[:2].tolist() == [0.5, 0.0]


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"scans": [1.0, np.nan]}, "scans: found nan in scan 0, beam 1, expected a range, or inf where nothing is met"),
        ({"scans": [[1.0, 2.0], [1.0, 2.0], [np.nan, 2.0]]}, "scans: found nan in scan 2, beam 0, expected a range"),
        ({"scans": np.zeros((2, 8))}, "scans: found shape (2, 8), expected (3, beams) or (beams,)"),
        ({"scans": []}, "scans: found shape (0,), expected (3, beams) or (beams,)"),
        ({"scans": None}, "scans: found None, expected an array of numbers"),
        ({"scans": [[1.0], [1.0, 2.0]]}, "scans: found [[1.0], [1.0, 2.0]], expected an array of numbers"),
        ({"goal": [np.inf, 0.0]}, "goal: found [inf, 0.0], expected two finite numbers"),
        ({"goal": [1.0]}, "goal: found shape (1,), expected (2,)"),
        ({"velocity": [np.nan, 0.0]}, "velocity: found [nan, 0.0], expected two finite numbers"),
        ({"max_range": np.inf}, "max_range: found inf, expected a finite number above 0"),
        ({"max_range": "far"}, "max_range: found 'far', expected a finite number above 0"),
    ],
)
def test_what_is_no_measurement_is_refused(keywords: dict, message: str) -> None:
    arguments = {"scans": [1.0, 2.0], "goal": [1.0, 0.0], "velocity": [0.0, 0.0], **keywords}
    with pytest.raises(ValueError) as error:
        jostle.scan_to_row(**arguments)
    assert str(error.value).startswith(message)
