"""A fit that is not well posed is refused with one line that says where, what was found and what was expected."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.errors import ArmonicError, ModelError, PostureError, UpdateError
from armonic.updating import Measurement
from models import oscillator, robot_of, spring
from robot_files import START

FREQ_HZ = np.arange(1, 61) / 2
THREE_R = am.load("huynh_3r")
H = am.frf(THREE_R, "milling", FREQ_HZ, frame="sensor")
DATA = Measurement(H, "milling")
STIFFNESS = "links.arm.elasticity.z.stiffness"  # 1.55e6


def refused(kind: type[ArmonicError], message: str, *parts: Any, robot: am.Robot = THREE_R, **options: Any) -> None:
    """Asserts that a fit raises this error, on one line."""
    with pytest.raises(kind, match=message) as caught:
        am.update(robot, *parts, **options)
    assert_one_line(caught.value)


def assert_one_line(error: ArmonicError) -> None:
    text = str(error)
    assert text == text.strip()
    assert "\n" not in text
    assert re.fullmatch(r".+: found .+, expected .+[.?]", text)


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        ((2e6, 3e6), rf"bounds of {STIFFNESS}: found \[2e\+06, 3e\+06\], which exclude the start 1.55e\+06, expected"),
        ((1e5, 1e6), "which exclude the start"),
        ((0.0, 3e6), r"found \(0.0, 3000000.0\), expected two positive numbers, low < high"),
        ((-1e6, 3e6), "two positive numbers"),
        ((3e6, 1e6), "low < high"),
        ((1.55e6, 1.55e6), "low < high"),
        ((np.nan, 3e6), r"found \(nan, 3000000.0\), expected two positive numbers"),
        ((1e6, np.nan), "two positive numbers"),
        ((1e6, np.inf), "two positive numbers"),
        ((1e6,), "two positive numbers"),
        ((1e6, 2e6, 3e6), "two positive numbers"),
        (1e6, "found 1000000.0, expected two positive numbers"),
        ("low", "found 'low', expected two positive numbers"),
        (None, "found None, expected two positive numbers"),
        (((1, 2), (3, 4)), "two positive numbers"),
    ],
)
def test_bounds_that_do_not_fit_are_refused(pair: Any, message: str) -> None:
    refused(UpdateError, message, DATA, bounds={STIFFNESS: pair})


def test_bounds_beyond_those_of_the_file_are_refused_for_the_result_could_not_be_loaded() -> None:
    robot = am.load(START)
    for pair in ((5e5, 4e6), (6e5, 5e6)):
        message = r"found \[.+\], expected bounds within those of the robot file, \[550000, 4e\+06\]\. Widen them"
        refused(UpdateError, message, DATA, robot=robot, bounds={STIFFNESS: pair})


@pytest.mark.parametrize("bounds", [{"links.arm.elasticity.z.stifness": (1e6, 2e6)}, {"links.elbow.*": (1e6, 2e6)}])
def test_bounds_of_a_parameter_that_is_not_there_are_refused(bounds: Mapping[str, tuple[float, float]]) -> None:
    refused(UpdateError, "expected the path of a stiffness or damping", DATA, bounds=bounds)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ("links.arm.elasticity.z.stifness", f"found 'links.arm.elasticity.z.stifness', .* Did you mean {STIFFNESS}"),
        ("links.elbow.*", "found 'links.elbow.*'"),
        (["stiffness", "nothing"], "found 'nothing'"),
        ([], "found no pattern"),
        ("", "found ''"),
    ],
)
def test_a_pattern_that_matches_nothing_is_refused(parameters: Any, message: str) -> None:
    refused(UpdateError, message, DATA, parameters=parameters)


def test_a_start_of_zero_is_refused_unless_it_is_left_out() -> None:
    path = "links.arm.elasticity.z.damping"
    robot = THREE_R.with_values({path: 0.0})
    refused(
        UpdateError, rf"{path}: found 0 to start from, expected a positive value.*small positive", DATA, robot=robot
    )
    assert am.update(robot, DATA, parameters="stiffness", max_evaluations=1).status == "limit"


def test_a_fit_needs_a_measurement() -> None:
    refused(UpdateError, "measurements: found none, expected at least one", [])


@pytest.mark.parametrize("tolerance", [0.0, -1e-6, np.nan, np.inf, 1e-17, 1.0])
def test_a_tolerance_out_of_range_is_refused(tolerance: float) -> None:
    refused(
        UpdateError, f"tolerance: found {tolerance}, expected a number from 2.2e-16 to 1", DATA, tolerance=tolerance
    )


@pytest.mark.parametrize("limit", [0, -3])
def test_a_limit_of_no_evaluations_is_refused(limit: int) -> None:
    message = f"max_evaluations: found {limit}, expected a whole number of at least 1"
    refused(UpdateError, message, DATA, max_evaluations=limit)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.ones(59), r"found shape \(59,\), expected shape \(60,\) or \(60, 3, 3\)"),
        (np.ones((60, 3)), r"found shape \(60, 3\)"),
        (np.ones((3, 3)), r"found shape \(3, 3\)"),
        (1.0, r"found shape \(\)"),
        (np.append(np.ones(59), -1e-9), "found a negative or non-finite number, expected numbers of zero or more"),
        (np.append(np.ones(59), np.nan), "non-finite"),
        (np.append(np.ones(59), np.inf), "non-finite"),
        (np.zeros(60), "found zero everywhere, expected at least one positive weight"),
        ("peak", 'found \'peak\', expected "peaks", "uniform" or numbers'),
        (np.ones(60) * 1j, 'expected "peaks", "uniform" or numbers'),
        (["heavy"] * 60, 'expected "peaks", "uniform" or numbers'),
        ([[1, 2], [3]], 'expected "peaks", "uniform" or numbers'),
    ],
)
def test_weights_that_do_not_fit_are_refused(weights: Any, message: str) -> None:
    with pytest.raises(UpdateError, match=message) as caught:
        Measurement(H, "milling", weights=weights, label="tap test 7")
    assert_one_line(caught.value)
    assert str(caught.value).startswith("tap test 7: weights: ")


@pytest.mark.parametrize("weights", ["peaks", "uniform", np.full(60, 2.0)])
def test_a_zero_in_a_response_is_refused_where_its_logarithm_counts(weights: Any) -> None:
    values = H.values.copy()
    values[17, 1, 2] = 0.0
    with pytest.raises(UpdateError, match=r"H_yz at 9 Hz: found a response of exactly zero, .*weight zero") as caught:
        Measurement(replace(H, values=values), "milling", weights=weights)
    assert_one_line(caught.value)
    ignored = np.ones(H.values.shape)
    ignored[17, 1, 2] = 0.0
    fit = am.update(THREE_R, Measurement(replace(H, values=values), "milling", weights=ignored))
    assert np.isfinite(fit.cost)


@pytest.mark.parametrize("kind", ["mobility", "accelerance"])
def test_a_line_at_zero_hertz_that_says_nothing_is_left_out(kind: am.response.Kind) -> None:
    G = am.frf(THREE_R, "milling", np.arange(61) / 2, frame="sensor", kind=kind)
    assert (G.values[0] == 0).all()
    data = Measurement(G, "milling", weights="uniform")
    assert (data.line_weights()[0] == 0).all()
    start = THREE_R.with_values({STIFFNESS: 1.7e6})
    with_it, without = (
        am.update(start, m, max_evaluations=1).cost for m in (data, Measurement(H, "milling", weights="uniform"))
    )
    assert with_it == pytest.approx(without, rel=1e-12)  # a few roundings per value


def test_a_line_at_zero_hertz_of_receptance_counts() -> None:
    G = am.frf(THREE_R, "milling", np.arange(61) / 2, frame="sensor", kind="receptance")
    start = THREE_R.with_values({STIFFNESS: 1.7e6})
    both = [
        am.update(start, Measurement(g, "milling", weights="uniform"), max_evaluations=1) for g in (G, G.band(0.5, 30))
    ]
    static = [
        am.frf(robot, "milling", [0.0], frame="sensor", kind="receptance").values.real for robot in (start, THREE_R)
    ]
    assert both[0].cost - both[1].cost == pytest.approx(np.sum(np.log(static[0] / static[1]) ** 2), rel=1e-6)


def test_a_line_at_zero_hertz_alone_is_nothing_to_fit() -> None:
    with pytest.raises(UpdateError, match="found zero everywhere"):
        Measurement(am.frf(THREE_R, "milling", [0.0], frame="sensor"), "milling", weights="uniform")


def test_a_measurement_needs_a_frame() -> None:
    nowhere = replace(H, frame=None)
    with pytest.raises(
        UpdateError, match=r"Measurement.frame: found nothing, expected the robot frame the sensor sits on"
    ):
        Measurement(nowhere, "milling")
    assert Measurement(nowhere, "milling", "arm").frame == "arm"


def test_an_unknown_frame_posture_or_axis_is_refused() -> None:
    refused(PostureError, "frame: found 'sensr', .*Did you mean sensor", Measurement(H, "milling", "sensr"))
    refused(PostureError, "posture: found 'miling', .*Did you mean milling", Measurement(H, "miling"))
    refused(PostureError, "posture: found 2 values, expected", Measurement(H, [0.0, 1.0]))
    refused(PostureError, "found nan", Measurement(H, [0.0, 1.0, np.nan]))
    along_w = replace(H, outputs=("x", "y", "w"))
    refused(ArmonicError, "outputs: found 'w', expected axes among x y z", Measurement(along_w, "milling"))


def test_the_second_of_two_measurements_is_checked_as_well() -> None:
    refused(PostureError, "found 'miling'", [DATA, Measurement(H, "miling")])
    refused(PostureError, "found 'sensr'", [DATA, Measurement(H, "milling", "sensr")])


def planar() -> am.Robot:
    """Two links that move in the x-z plane; along y the tip stands still whatever the springs."""
    links = [
        {
            "name": name,
            "parent": parent,
            "placement": placement,
            "joint": {"type": "revolute", "axis": "z"},
            "elasticity": {"z": spring(1e5, 30.0)},
            "mass": 10,
            "com": [0.4, 0, 0],
            "inertia": {"xx": 0.1, "yy": 0.5, "zz": 0.5},
        }
        for name, parent, placement in (("upper", "base", [{"rx": "90 deg"}]), ("lower", "upper", [{"x": 0.8}]))
    ]
    # The quarter turns there and back leave 6e-17 where zeros should stand.
    tip = {"name": "tip", "link": "lower", "placement": [{"x": 0.8}, {"rx": "-90 deg"}]}
    return robot_of(links, frames=[tip], postures={"bent": [0.3, 0.7]})


def test_a_response_that_the_model_cannot_have_is_named_with_what_to_do() -> None:
    robot, rng = planar(), np.random.default_rng(1)
    clean = am.frf(robot, "bent", FREQ_HZ, frame="tip")
    floor = 1e-6 * np.abs(clean.values).max() * rng.standard_normal(clean.values.shape)
    noisy = replace(clean, values=clean.values + floor)
    for G in (noisy, clean):  # what a sensor picks up there, and what rounding leaves of zero
        message = (
            r"bent, tip: H_xy: found a measured response that is zero in the model, .* along x under a load along y"
        )
        refused(ModelError, message + r".*frf\.select", Measurement(G, "bent", weights="uniform"), robot=robot)
    # Either way out that the message names works.
    seen = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]], float)
    ways = (
        Measurement(noisy.select(outputs=["x", "z"], inputs=["x", "z"]), "bent", weights="uniform"),
        Measurement(noisy, "bent", weights=np.broadcast_to(seen, noisy.values.shape)),
    )
    costs = [am.update(robot, m).cost for m in ways]
    assert costs[0] == pytest.approx(costs[1], rel=1e-9)


def test_an_undamped_resonance_right_on_a_line_is_an_error_and_no_nan() -> None:
    # 1 kg on a spring that cancels its inertia at the sixth line to the last bit.
    omega = 2 * np.pi * FREQ_HZ[5]
    truth = oscillator(1.0, 400.0, 2.0)
    G = am.frf(truth, {}, FREQ_HZ, frame="mass_0").select(outputs="x", inputs="x")
    start = oscillator(1.0, float(omega**2))
    data = Measurement(G, {}, weights="uniform")
    refused(
        ModelError,
        "found the dynamic stiffness is singular at line 5: an undamped resonance",
        data,
        robot=start,
        parameters="stiffness",
    )


def test_any_other_start_than_the_resonance_is_fitted_even_without_damping() -> None:
    truth = oscillator(1.0, 400.0)
    G = am.frf(truth, {}, FREQ_HZ, frame="mass_0").select(outputs="x", inputs="x")
    fit = am.update(oscillator(1.0, 380.0), Measurement(G, {}, weights="uniform"), parameters="stiffness")
    assert np.isfinite(fit.cost)
    assert fit.cost <= fit.start_cost


def test_bounds_that_only_rounding_tells_apart_are_refused() -> None:
    bounds = {STIFFNESS: (2.0e6, float(np.nextafter(2.0e6, 1e99)))}
    refused(UpdateError, "two positive numbers, low < high", DATA, bounds=bounds)


def test_responses_too_small_to_take_a_logarithm_of_are_refused() -> None:
    tiny = replace(DATA.frf, values=DATA.frf.values * 1e-200)
    refused(UpdateError, r"measurements: found .*e-\d+, expected", Measurement(tiny, "milling", weights="uniform"))


def test_a_bare_response_is_no_measurement() -> None:
    refused(UpdateError, r"found a Frf, expected at least one Measurement", [DATA.frf])


OTHER = "links.carousel.elasticity.z.stiffness"
LAST = "links.link_arm.elasticity.z.stiffness"
A_PATTERN = "expected a path or pattern, or a list of them"
WHOLE = "expected a whole number of at least"
ABSURD: list[tuple[dict[str, Any], str]] = [
    ({"parameters": 5}, f"parameters: found 5, {A_PATTERN}"),
    ({"parameters": None}, f"parameters: found None, {A_PATTERN}"),
    ({"parameters": [STIFFNESS, 5]}, f"parameters: found 5, {A_PATTERN}"),
    ({"bounds": 5}, "bounds: found 5, expected a mapping"),
    ({"bounds": [STIFFNESS]}, r"bounds: found \['links.*, expected a mapping"),
    ({"bounds": {5: (1e6, 2e6)}}, f"bounds: found 5, {A_PATTERN}"),
    ({"hold": 5}, f"hold: found 5, {A_PATTERN}"),
    ({"hold": 0}, f"hold: found 0, {A_PATTERN}"),
    ({"hold": None}, f"hold: found None, {A_PATTERN}"),
    ({"hold": "nothing"}, "hold: found 'nothing', expected the path"),
    ({"hold": "elasticity"}, "hold: found every parameter, expected at least one that is fitted"),
    ({"hold": {STIFFNESS: -1.0}}, f"hold {STIFFNESS}: found -1.0, expected a positive number"),
    ({"hold": {STIFFNESS: np.nan}}, f"hold {STIFFNESS}: found nan, expected a finite number"),
    ({"hold": {STIFFNESS: "stiff"}}, f"hold {STIFFNESS}: found 'stiff', expected a number in N m/rad"),
    ({"hold": {STIFFNESS: None}}, f"hold {STIFFNESS}: found nothing, expected a number"),
    ({"hold": {"*.damping": 5.0}}, r"hold \*.damping: found '\*.damping', expected the path"),
    ({"ties": 5}, "ties: found 5, expected groups of paths"),
    ({"ties": None}, "ties: found None, expected groups of paths"),
    ({"ties": STIFFNESS}, "ties: found 'links.*expected groups of paths"),
    ({"ties": [5]}, f"ties: found 5, {A_PATTERN}"),
    ({"ties": [[STIFFNESS, 5]]}, f"ties: found 5, {A_PATTERN}"),
    ({"ties": [[]]}, "ties: found no pattern"),
    ({"ties": [["nothing", STIFFNESS]]}, "ties: found 'nothing'"),
    ({"ties": [STIFFNESS, OTHER]}, "found one number, expected at least two to tie together"),
    ({"ties": [[STIFFNESS, STIFFNESS]]}, "found one number, expected at least two"),
    ({"ties": ["links.arm.elasticity.z.*"]}, "found N m s/rad and N m/rad, expected numbers of one kind"),
    ({"ties": [[STIFFNESS, "links.arm.mass"]]}, "found links.arm.mass, which is not fitted"),
    ({"method": "newton"}, "method: found 'newton', expected"),
    ({"method": ["genetic"]}, "method: found"),
    ({"cost": "frac"}, 'cost: found \'frac\', expected "logarithmic" or "relative"'),
    ({"cost": None}, "cost: found None"),
    ({"loss": "l1"}, 'loss: found \'l1\', expected "squares" or "huber" or "cauchy"'),
    ({"genetic": "fast", "method": "genetic"}, "genetic: found a str, expected a Genetic"),
    ({"genetic": am.Genetic()}, r'genetic: found options beside method="continuation"'),
    ({"starts": 0}, f"starts: found 0, {WHOLE} 1"),
    ({"starts": 1.5}, f"starts: found 1.5, {WHOLE} 1"),
    ({"starts": True}, f"starts: found True, {WHOLE} 1"),
    ({"starts": "4"}, f"starts: found '4', {WHOLE} 1"),
    ({"seed": -1}, f"seed: found -1, {WHOLE} 0"),
    ({"seed": None}, f"seed: found None, {WHOLE} 0"),
    ({"threads": 0}, f"threads: found 0, {WHOLE} 1"),
    ({"threads": "all"}, f"threads: found 'all', {WHOLE} 1"),
    ({"tolerance": "tight"}, "tolerance: found tight, expected a number"),
    ({"tolerance": None}, "tolerance: found None, expected a number"),
    ({"tolerance": 1j}, "tolerance: found 1j, expected a number"),
    ({"tolerance": np.ones(2)}, r"tolerance: found \[1. 1.\], expected a number"),
    ({"max_evaluations": 1.5}, f"max_evaluations: found 1.5, {WHOLE} 1"),
    ({"max_evaluations": np.nan}, f"max_evaluations: found nan, {WHOLE} 1"),
    ({"max_evaluations": "many"}, f"max_evaluations: found 'many', {WHOLE} 1"),
    ({"checkpoint": 5}, "checkpoint: found 5, expected the path of a file"),
    ({"checkpoint": "."}, "checkpoint .: found a place that cannot be read"),
    ({"checkpoint": "no/such/folder/run.json"}, "found no such folder"),
    ({"progress": 5}, "progress: found 5, expected a function of one Progress"),
]


@pytest.mark.parametrize(("options", "message"), ABSURD, ids=lambda value: str(value)[:60])
def test_an_absurd_option_is_refused_in_one_line(options: dict[str, Any], message: str) -> None:
    refused(UpdateError, message, DATA, **options)


@pytest.mark.parametrize("given", [None, 5, "milling", [DATA, 5], (DATA, None)])
def test_what_is_no_measurement_is_refused(given: Any) -> None:
    refused(UpdateError, r"measurements: found .*, expected at least one Measurement", given)


@pytest.mark.parametrize("robot", [None, "huynh_3r", 5])
def test_what_is_no_robot_is_refused(robot: Any) -> None:
    refused(UpdateError, r"robot: found a \w+, expected a Robot", DATA, robot=robot)


def test_ties_that_contradict_each_other_the_bounds_or_what_is_held_are_refused() -> None:
    tie = rf"tie of {OTHER}, {STIFFNESS}"
    refused(
        UpdateError,
        rf"{tie}: found bounds that have no value in common, expected bounds that overlap. Widen them",
        DATA,
        ties=[[STIFFNESS, OTHER]],
        bounds={STIFFNESS: (1e6, 1.6e6), OTHER: (1.7e6, 3e6)},
    )
    refused(
        UpdateError,
        rf"ties: found {OTHER} in two of them, .* Join them",
        DATA,
        ties=[[STIFFNESS, OTHER], [OTHER, LAST]],
    )
    for hold in (STIFFNESS, {STIFFNESS: 1.5e6}):
        message = rf"{tie}: found {STIFFNESS}, which is held, expected numbers that are all fitted"
        refused(UpdateError, message, DATA, ties=[[STIFFNESS, OTHER]], hold=hold)


def test_a_robust_loss_or_another_cost_of_modes_alone_is_refused() -> None:
    found = am.modes(THREE_R, "milling")
    modes = am.ModalMeasurement("milling", found.natural_freq_hz, found.damping_ratio)
    refused(UpdateError, 'loss: found "huber" for modes alone, expected "squares"', modes, loss="huber")
    refused(UpdateError, 'cost: found "relative" for modes alone, expected "logarithmic"', modes, cost="relative")


ONES = np.ones(60)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mask": np.zeros(60, bool)}, "mask: found false everywhere, expected true for at least one value"),
        ({"mask": np.ones(60, int)}, "mask: found .*, expected booleans"),
        ({"mask": "all"}, "mask: found .*, expected booleans"),
        ({"mask": [None] * 60}, "mask: found .*, expected booleans"),
        ({"mask": np.ones(59, bool)}, r"mask: found shape \(59,\), expected shape \(60,\) or \(60, 3, 3\)"),
        ({"coherence": 0 * ONES}, "coherence: found zero everywhere, expected at least one above zero"),
        ({"coherence": 1.1 * ONES}, "coherence: found a value out of range, expected γ² from 0 to 1"),
        ({"coherence": -ONES}, "coherence: found a value out of range"),
        ({"coherence": np.nan * ONES}, "coherence: found a value out of range"),
        ({"coherence": 1j * ONES}, "coherence: found .*, expected numbers"),
        ({"coherence": "good"}, "coherence: found .*, expected numbers"),
        ({"coherence": 0.9}, r"coherence: found shape \(\)"),
        ({"coherence": [[1], [1, 2]]}, "coherence: found .*, expected numbers"),
        ({"band": (40, 50)}, "band: found no value from 40 to 50 Hz, expected at least one"),
        ({"band": (5.1, 5.2)}, "band: found no value from 5.1 to 5.2 Hz"),
        ({"band": (10, 5)}, r"band: found \(10, 5\), expected \(low, high\) in Hz"),
        ({"band": 5}, r"band: found 5, expected \(low, high\) in Hz"),
        ({"band": (1, 2, 3)}, r"expected \(low, high\) in Hz"),
        ({"band": ("a", "b")}, r"expected \(low, high\) in Hz"),
        ({"band": (np.nan, 5)}, r"expected \(low, high\) in Hz"),
        ({"band": (1j, 2)}, r"expected \(low, high\) in Hz"),
        ({"mask": FREQ_HZ > 20, "band": (1, 10)}, "band: found no value from 1 to 10 Hz"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_what_leaves_nothing_to_fit_or_does_not_fit_itself_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UpdateError, match=message) as caught:
        Measurement(H, "milling", label="tap test 7", **options)
    assert_one_line(caught.value)
    assert str(caught.value).startswith("tap test 7: ")


def test_fewer_numbers_than_parameters_are_refused_and_as_many_leave_every_interval_open() -> None:
    three, two = (H.band(5, 5.1).select(outputs="x", inputs=axes) for axes in (["x", "y", "z"], ["x", "y"]))
    message = "measurements: found 4 numbers for 6 parameters, expected at least as many .* give priors"
    refused(UpdateError, message, Measurement(two, "milling", weights="uniform"))
    # Six numbers tell six parameters, but not how much noise there was.
    fit = am.update(THREE_R, Measurement(three, "milling", weights="uniform"))
    assert {p.verdict for p in fit.parameters} == {"not identifiable"}
    assert any("Nothing is identified: there are as many parameters as numbers" in doubt for doubt in fit.doubts)
    # What has weight zero is no number, and neither is a tie's second.
    weights = np.array([[[1.0, 1.0, 0.0]]])
    refused(UpdateError, "found 4 numbers for 6", Measurement(three, "milling", weights=weights))
    tied = am.update(THREE_R, Measurement(two, "milling", weights="uniform"), ties=["stiffness"])
    assert len(tied.parameters) == 4
    modes = am.ModalMeasurement("milling", am.modes(THREE_R, "milling").natural_freq_hz)
    refused(UpdateError, "found 3 numbers for 6 parameters", modes)


def noisy(G: am.Frf, noise: float, seed: int = 1) -> am.Frf:
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *G.values.shape))
    return replace(G, values=G.values * (1 + noise * (real + 1j * imaginary)))


def test_a_band_without_any_resonance_is_doubted_by_name() -> None:
    # The lowest mode is at 10 Hz.
    below = noisy(am.frf(THREE_R, "milling", np.linspace(0.1, 1, 40), frame="sensor"), 0.01)
    fit = am.update(THREE_R, Measurement(below, "milling", weights="uniform", label="tap test 7"))
    assert any("No response of tap test 7 has a resonance between 0.1 and 1 Hz" in doubt for doubt in fit.doubts)
    assert any(p.verdict == "not identifiable" for p in fit.parameters if p.path.endswith("damping"))
    both = am.update(THREE_R, [Measurement(below, "milling", label="tap test 7"), DATA])
    assert sum("has a resonance" in doubt for doubt in both.doubts) == 1
    assert not am.update(THREE_R, DATA).doubts


def test_noise_in_which_nothing_is_left_is_said() -> None:
    # Dampings from where only stiffness shows: 2 ζ f/f_n = some 1e-3 of the response, in 10 % of noise.
    below = noisy(am.frf(THREE_R, "milling", np.linspace(0.1, 1, 15), frame="sensor"), 0.1, 2)
    fit = am.update(THREE_R, Measurement(below, "milling", weights="uniform"), parameters="damping")
    assert not {p.verdict for p in fit.parameters} & {"identified", "weak"}
    (said,) = (doubt for doubt in fit.doubts if doubt.startswith("Nothing is identified"))
    assert "with a noise of" in said
    drowned = am.update(THREE_R, Measurement(noisy(H, 3.0), "milling"), max_evaluations=100)
    assert any("does not explain these data" in doubt for doubt in drowned.doubts)
    assert "identified" not in {p.verdict for p in drowned.parameters}


@pytest.mark.parametrize("limit", [1, 2, 5, 20, 60])
@pytest.mark.parametrize("seed", range(3))
def test_no_fit_ends_above_its_start_whatever_the_data(limit: int, seed: int) -> None:
    elsewhere = am.frf(THREE_R, [0.4, 0.9, -1.2], FREQ_HZ, frame="sensor")
    rng = np.random.default_rng(seed)
    start = THREE_R.with_values({p: v * 3 ** rng.uniform(-1, 1) for p, v in THREE_R.parameters().items()})
    for data in (Measurement(elsewhere, "milling"), Measurement(noisy(H, 0.5, seed), "milling", weights="uniform")):
        fit = am.update(start, data, max_evaluations=limit)
        assert fit.cost <= fit.start_cost


def test_a_number_on_its_bound_that_the_data_know_well_is_not_called_unknown() -> None:
    fit = am.update(
        THREE_R.with_values({STIFFNESS: 1.3e6}), DATA, parameters=STIFFNESS, bounds={STIFFNESS: (1e6, 1.5e6)}
    )
    assert [(p.verdict, p.value) for p in fit.parameters] == [("at bound", 1.5e6)]
    assert not any("Nothing is identified" in doubt for doubt in fit.doubts)
