"""The walk visits every place once, in short steps; grids and samples hold what single postures give."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import armonic as am
from armonic.surveying.walk import block_shape, blocks, reflected

shapes = st.lists(st.integers(1, 7), min_size=1, max_size=4)


@given(shapes)
def test_each_step_of_the_walk_changes_one_axis_by_one_place(shape: list[int]) -> None:
    count = math.prod(shape)
    places = reflected(shape, np.arange(count))
    assert sorted(places.tolist()) == list(range(count))
    steps = np.abs(np.diff(np.array(np.unravel_index(places, shape)), axis=1)).sum(axis=0)
    assert (steps == 1).all()


@settings(deadline=None)
@given(shapes, st.integers(1, 60))
def test_blocks_tile_the_box_in_the_order_of_the_walk(shape: list[int], target: int) -> None:
    box = np.zeros(shape, int)
    step = 0
    for start, stop, part in blocks(shape, block_shape(shape, target)):
        assert start == step
        inside = np.unravel_index(reflected(shape, np.arange(start, stop)), shape)
        for index, limits in zip(inside, part, strict=True):
            assert limits.start <= index.min()
            assert index.max() < limits.stop
        assert stop - start == math.prod(s.stop - s.start for s in part) <= target
        box[part] += 1
        step = stop
    assert step == math.prod(shape)
    assert (box == 1).all()


def test_every_point_of_a_grid_has_the_modes_of_that_posture() -> None:
    robot = am.load("scompi")
    axes = {"link_2.z": np.linspace(-0.5, 0.5, 4), "link_4.z": np.linspace(0, 1, 3), "link_5.z": np.linspace(-2, -1, 5)}
    survey = am.survey(robot, am.Grid(axes, base="c8"))
    assert dict(survey.natural_freq_hz.sizes) == {"link_2.z": 4, "link_4.z": 3, "link_5.z": 5, "mode": 12}
    base = robot.posture("c8")
    for i, j, k in np.ndindex(4, 3, 5):
        q = base.copy()
        q[[1, 3, 4]] = [values[at] for values, at in zip(axes.values(), (i, j, k), strict=True)]
        found = np.sort(survey.natural_freq_hz.values[i, j, k])
        np.testing.assert_allclose(found, am.modes(robot, q).natural_freq_hz, rtol=1e-9)


def test_a_sample_lies_in_its_ranges_and_is_the_same_for_the_same_seed() -> None:
    robot = am.load("scompi")
    for kind in ("sobol", "random"):
        sample = am.Sample({"link_2.z": (-0.5, 0.5), "link_3.z": (1.0, 2.0)}, 100, kind=kind, seed=4, base="c8")
        one, two = am.survey(robot, sample), am.survey(robot, sample)
        np.testing.assert_array_equal(one.pole.values, two.pole.values)
        x, y = one["link_2.z"].values, one["link_3.z"].values
        assert len({*zip(x, y, strict=True)}) == 100
        assert (np.abs(x) <= 0.5).all()
        assert ((y >= 1) & (y <= 2)).all()
        # Neighbours follow each other: far shorter steps than between points in random order (0.52 on average).
        assert np.hypot(np.diff(x), np.diff(y)).mean() < 0.2
        assert (one["link_4.z"].values == robot.posture("c8")[3]).all()


@pytest.mark.parametrize(
    ("postures", "options", "said"),
    [
        ("nowhere", {}, "nowhere"),
        ([], {}, "an empty list"),
        (np.full((3, 6), np.nan), {}, "row 0"),
        (np.zeros((3, 4)), {}, "4 values"),
        (7, {}, "found"),
        (am.Grid({"link_9.z": [0, 1]}), {}, "link_9.z"),
        (am.Grid({}), {}, "at least one coordinate"),
        (am.Grid({"link_2.z": [0, np.inf]}), {}, "finite"),
        (am.Grid({"link_2.z": np.zeros(2**21), "link_3.z": np.zeros(2**21)}), {}, "4.4e+12 postures"),
        (am.Sample({"link_2.z": (1, 0)}, 10), {}, "lowest and highest"),
        (am.Sample({"link_2.z": (0, 1)}, 0), {}, "count"),
        (am.Sample({"link_2.z": (0, 1)}, 10, kind="best"), {}, "sobol"),  # type: ignore[arg-type]
        ("table", {"sweep": {"control.kp": [1, 2], "control.kd": [1, 2, 3]}}, "the same number of each"),
        ("table", {"sweep": {"control.kq": [1, 2]}}, "control.kq"),
        ("table", {"sweep": {"control.ki": [0, 10]}}, "poles appear"),
        ("table", {"sweep": {"control.kp": [-5.0]}}, "control.kp"),
        ("table", {"threads": 0}, "threads"),
        ("table", {"wrench": [1, 0, 0, 0, 0, 0]}, "frame"),
    ],
)
def test_bad_surveys_are_refused_in_one_line(postures: object, options: dict[str, object], said: str) -> None:
    with pytest.raises(am.ArmonicError, match="found") as refusal:
        am.survey(am.load("scompi"), postures, **options)  # type: ignore[arg-type]
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
