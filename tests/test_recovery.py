"""Fits of responses that were computed from known parameters find these parameters again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom, chi2

import armonic as am
from armonic.updating.measurement import levelled
from models import oscillator
from robot_files import START

Array = NDArray[np.float64]

# Huynh et al. 2021, section 4: a line every 0.2 Hz up to 30 Hz, gain 50 at peaks.
FREQ_HZ = np.arange(1, 151) / 5
PEAK_GAIN_3R = 50.0
RECOVERED = 1e-6
THREE_R = am.load("huynh_3r")
KUKA = am.load("kuka_kr90")
ELSEWHERE = ([0.4, 0.9, -1.2], {"carousel.z": -0.5, "link_arm.z": 1.6, "arm.z": "-2 rad"})


def measured(robot: am.Robot, posture: Any = "milling", **options: Any) -> am.Frf:
    return am.frf(robot, posture, options.pop("freq_hz", FREQ_HZ), frame="sensor", **options)


def noisy(H: am.Frf, seed: int, noise: float = 0.01) -> am.Frf:
    """With a relative error whose real and imaginary parts have the standard deviation `noise`."""
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *H.values.shape))
    return replace(H, values=H.values * (1 + noise * (real + 1j * imaginary)))


def off(robot: am.Robot, rng: np.random.Generator, factor: float, pattern: str = "elasticity") -> am.Robot:
    """Another start: each parameter up to a factor away, either side."""
    return robot.with_values({p: v * factor ** rng.uniform(-1, 1) for p, v in robot.parameters(pattern).items()})


def worst(fit: am.Fit, truth: am.Robot) -> float:
    """Largest relative error of a fitted parameter."""
    true = truth.parameters()
    return max(abs(p.value / true[p.path] - 1) for p in fit.parameters)


def test_the_three_axis_robot_is_recovered_from_twenty_random_starts() -> None:
    H, rng = measured(THREE_R), np.random.default_rng(2021)
    weights = am.peak_weights(H, peak_gain=PEAK_GAIN_3R)
    fits = [
        am.update(off(THREE_R, rng, 2.0), am.Measurement(H, "milling", weights=weights), parameters="elasticity")
        for _ in range(20)
    ]
    assert [len(fit.parameters) for fit in fits] == [6] * 20
    assert max(worst(fit, THREE_R) for fit in fits) < RECOVERED
    # The paper needed 1400; these take some 27, ladder and all.
    assert max(fit.evaluations for fit in fits) <= 40


@pytest.mark.parametrize("lines_per_hz", [5, 2])
def test_the_kuka_is_recovered_from_the_start_of_table_4(lines_per_hz: int) -> None:
    H = measured(KUKA, freq_hz=np.arange(1, 30 * lines_per_hz + 1) / lines_per_hz)
    fit = am.update(am.load(START), am.Measurement(H, "milling"))
    assert (fit.status, len(fit.parameters)) == ("converged", 18)
    assert fit.cost < 1e-3  # the paper stopped at 64
    assert worst(fit, KUKA) < RECOVERED
    # Around 100; changes of the start in the ninth digit, or another processor's rounding, give 70 to 250.
    assert fit.evaluations <= 300


@pytest.mark.parametrize("seed", range(6))
def test_with_noise_the_kuka_fit_ends_as_low_as_one_that_starts_from_the_truth(seed: int) -> None:
    # Without the pass under levelled weights two in three of these end ten times higher, several at their bounds.
    data = am.Measurement(noisy(measured(KUKA, freq_hz=np.arange(10, 150) / 5), seed), "milling")
    start = am.load(START)
    bounds = {path: start.bounds(path) for path in start.parameters()}
    from_table_4, from_truth = am.update(start, data), am.update(KUKA, data, bounds=bounds)
    assert from_table_4.cost < 1.01 * from_truth.cost
    assert from_table_4.evaluations <= 300


SUBSETS: dict[str, Callable[[am.Frf], list[am.Frf]]] = {
    "H_zz alone": lambda H: [H.select(outputs="z", inputs="z")],
    "one column": lambda H: [H.select(inputs="y")],
    "one row, in another order": lambda H: [H.select(outputs="x", inputs=("z", "y", "x"))],
    "two by three": lambda H: [H.select(outputs=("z", "x"))],
    "the diagonal, one by one": lambda H: [H.select(outputs=a, inputs=a) for a in "xyz"],
    "rotations": lambda H: [measured(THREE_R, outputs=("rx", "ry"), inputs=("z",))],
}


@pytest.mark.parametrize("subset", SUBSETS)
def test_any_subset_of_the_responses_is_enough(subset: str) -> None:
    # A single response has other minima further off, where two close modes have changed places.
    start = off(THREE_R, np.random.default_rng(3), 1.05 if subset == "H_zz alone" else 1.3)
    data = [am.Measurement(H, "milling", "sensor") for H in SUBSETS[subset](measured(THREE_R))]
    assert worst(am.update(start, data), THREE_R) < RECOVERED


def test_the_diagonal_alone_is_fitted_where_the_rest_has_weight_zero() -> None:
    H = measured(THREE_R)
    hidden = replace(H, values=np.where(np.eye(3, dtype=bool), H.values, 0.0))
    weights = np.broadcast_to(np.eye(3), H.values.shape)
    fit = am.update(off(THREE_R, np.random.default_rng(4), 1.3), am.Measurement(hidden, "milling", weights=weights))
    assert worst(fit, THREE_R) < RECOVERED


@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
def test_every_kind_of_response_is_fitted_and_a_line_at_zero_hertz_does_no_harm(kind: am.response.Kind) -> None:
    H = measured(THREE_R, freq_hz=np.arange(151) / 5, kind=kind)
    fit = am.update(off(THREE_R, np.random.default_rng(5), 1.3), am.Measurement(H, "milling"))
    assert worst(fit, THREE_R) < RECOVERED


def test_measurements_at_several_postures_are_fitted_together() -> None:
    parts = ("z", "x", "y")
    data = [
        am.Measurement(measured(KUKA, posture).select(inputs=axis), posture)
        for posture, axis in zip(("milling", *ELSEWHERE), parts, strict=True)
    ]
    fit = am.update(am.load(START), data)
    assert worst(fit, KUKA) < RECOVERED
    assert len(fit.postures) == len(fit.before) == len(fit.after) == len(fit.mac) == 3
    assert [H.inputs for H in fit.frf_after] == [(axis,) for axis in parts]


def test_different_lines_kinds_frames_and_weights_go_into_one_fit() -> None:
    at_flange = am.frf(THREE_R, ELSEWHERE[0], np.geomspace(1, 40, 33), frame="arm", outputs=("x", "z"), kind="mobility")
    data = [
        am.Measurement(measured(THREE_R), "milling"),
        am.Measurement(at_flange, ELSEWHERE[0], weights=np.linspace(0.0, 3.0, 33)),
    ]
    assert worst(am.update(off(THREE_R, np.random.default_rng(6), 1.5), data), THREE_R) < RECOVERED


def test_only_the_chosen_parameters_change() -> None:
    for pattern, count in (("stiffness", 9), ("links.arm.elasticity.*", 6), (["*.z.damping", "*.z.stiffness"], 6)):
        start = off(KUKA, np.random.default_rng(7), 1.2, pattern)
        fit = am.update(start, am.Measurement(measured(KUKA), "milling"), parameters=pattern)
        assert len(fit.parameters) == count
        assert worst(fit, KUKA) < RECOVERED
        untouched = KUKA.parameters().keys() - {p.path for p in fit.parameters}
        assert all(fit.robot.parameters()[path] == KUKA.parameters()[path] for path in untouched)


def test_bounds_of_the_call_are_kept() -> None:
    start = am.load(START)
    path = "links.arm.elasticity.z.stiffness"
    fit = am.update(
        start, am.Measurement(measured(KUKA), "milling"), bounds={"*.z.stiffness": (6e5, 4e6), path: (6e5, 2e6)}
    )
    by_path = {p.path: p for p in fit.parameters}
    assert (by_path[path].lower, by_path[path].upper) == (6e5, 2e6)
    assert by_path["links.link_arm.elasticity.z.stiffness"].upper == 4e6
    assert by_path["links.arm.elasticity.x.stiffness"].upper == 1e8  # the file's
    assert all(p.lower <= p.value <= p.upper for p in fit.parameters)
    assert by_path[path].verdict == "at bound"  # 2.8e6 would be right
    assert by_path[path].value == pytest.approx(2e6, rel=1e-3)


def test_a_start_on_its_bound_is_admitted() -> None:
    start = off(THREE_R, np.random.default_rng(8), 1.3)
    path = "links.carousel.elasticity.z.damping"
    value = start.parameters()[path]
    for bounds in ((value, 1e5), (1.0, value)):
        fit = am.update(start, am.Measurement(measured(THREE_R), "milling"), bounds={path: bounds})
        assert bounds[0] <= fit.robot.parameters()[path] <= bounds[1]


def test_the_tightest_tolerance_is_reached() -> None:
    start = off(THREE_R, np.random.default_rng(9), 1.5)
    fit = am.update(start, am.Measurement(measured(THREE_R), "milling"), tolerance=float(np.finfo(float).eps))
    assert fit.status == "converged"
    assert worst(fit, THREE_R) < 1e-12  # rounding of a response, 1e-15, by its weakest sensitivity, some 1e-2


@pytest.mark.parametrize("weights", ["uniform", "peaks"])
def test_intervals_hold_the_truth_as_often_as_they_claim(weights: str) -> None:
    draws, H, truth = 40, measured(THREE_R), np.array(list(THREE_R.parameters().values()))
    fits = [am.update(THREE_R, am.Measurement(noisy(H, seed), "milling", weights=weights)) for seed in range(draws)]
    assert {p.verdict for fit in fits for p in fit.parameters} == {"identified"}
    # 9 responses of 150 lines in two parts, less 6 parameters: σ is known to 1 / sqrt(2 · 2694) = 1.4 %; four times
    # that.
    assert max(abs(fit.noise / 0.01 - 1) for fit in fits) < 0.055
    ends = np.log([[p.interval for p in fit.parameters] for fit in fits])
    held = ((ends[..., 0] <= np.log(truth)) & (np.log(truth) <= ends[..., 1])).sum(axis=0)
    # A 95 % interval misses by chance: fewer hits than this have a probability of 1e-5 per parameter.
    assert held.min() >= binom.ppf(1e-5, draws, 0.95)
    # And it is not generous: the errors in units of their standard deviation have the spread they should.
    deviation = (ends[..., 1] - ends[..., 0]) / (2 * 1.96)
    spread = (((ends.mean(axis=2) - np.log(truth)) / deviation) ** 2).sum(axis=0)
    assert (chi2.ppf(1e-5, draws) < spread).all()
    assert (spread < chi2.ppf(1 - 1e-5, draws)).all()


def peak_lines(weights: Array) -> list[list[int]]:
    """Lines of each run of high weights."""
    high = np.flatnonzero(weights > 1)
    return [run.tolist() for run in np.split(high, np.flatnonzero(np.diff(high) > 1) + 1)]


def resonance(
    hz: Sequence[float], *, kind: am.response.Kind = "accelerance", freq_hz: Array = FREQ_HZ, ratio: float = 0.01
) -> am.Frf:
    """Sum of the responses of oscillators of 1 kg and one damping ratio."""
    parts = []
    for f in hz:
        k = (2 * np.pi * f) ** 2
        parts.append(am.frf(oscillator(1.0, k, 2 * ratio * np.sqrt(k)), {}, freq_hz, frame="mass_0", kind=kind))
    one = parts[0].select(outputs="x", inputs="x")
    return replace(one, values=sum(p.values[:, :1, :1] for p in parts))


@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_peak_weights_are_80_at_each_peak_and_two_lines_around_and_a_half_elsewhere(
    kind: am.response.Kind, noise: float
) -> None:
    # Line i is at (i + 1) / 5 Hz.
    weights = am.peak_weights(noisy(resonance([6.0, 20.0], kind=kind), 1, noise))[:, 0, 0]
    assert peak_lines(weights) == [[27, 28, 29, 30, 31], [97, 98, 99, 100, 101]]
    assert set(weights) == {80.0, 0.5}


@pytest.mark.parametrize("kind", ["receptance", "mobility", "accelerance"])
def test_peaks_are_those_of_the_accelerance_whatever_the_kind(kind: am.response.Kind) -> None:
    # It peaks at f / sqrt(1 - 2 ζ²) = 3.031 Hz; mobility would at 3 Hz, receptance at 2.970 Hz.
    freq_hz = np.arange(200, 400) / 100
    weights = am.peak_weights(resonance([3.0], kind=kind, freq_hz=freq_hz, ratio=0.1))[:, 0, 0]
    assert freq_hz[weights == 80].tolist() == [3.01, 3.02, 3.03, 3.04, 3.05]


def test_peak_weights_can_be_set() -> None:
    weights = am.peak_weights(resonance([0.4]), peak_gain=7.0, base_gain=2.0, half_width=3)[:, 0, 0]
    assert weights[:6].tolist() == [7.0, 7.0, 7.0, 7.0, 7.0, 2.0]  # the band ends before the third neighbour
    strict = am.peak_weights(resonance([6.0, 20.0]), prominence_db=100.0)
    assert (strict == 0.5).all()


def test_noise_alone_has_no_peaks() -> None:
    flat = noisy(replace(resonance([6.0]), values=np.ones((150, 1, 1))), 2, 0.05)
    assert (am.peak_weights(flat) == 0.5).all()


def test_levelled_weights_lose_their_emphasis_and_keep_what_was_turned_down() -> None:
    peaks = am.peak_weights(noisy(measured(KUKA), 3))
    assert (levelled(peaks) == 0.5).all()
    weights = np.array([0.0, 1e-6, 1.0, 1.0, 1.0, 1.0, 1.0, 80.0, 80.0])[:, None, None]
    assert levelled(weights).ravel().tolist() == [0.0, 1e-6, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]


def test_a_force_at_another_frame_than_the_sensor_is_fitted_as_such() -> None:
    truth = am.load("huynh_3r")
    H = am.frf(truth, "milling", FREQ_HZ, frame="sensor", inputs="y", input_frame="arm")
    start = truth.with_values({path: 1.5 * value for path, value in truth.parameters().items()})
    fit = am.update(start, am.Measurement(H, posture="milling"))
    for path, value in truth.parameters().items():
        assert fit.robot.parameters(path)[path] == pytest.approx(value, rel=1e-6)  # noise-free
