"""What a fit may be asked for besides: ties, held numbers, several postures, robust losses, coherence, masks, modes,
and numbers other than stiffness and damping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import armonic as am
from models import oscillator, robot_of, spring

Array = NDArray[np.float64]

FREQ_HZ = np.arange(1, 151) / 5
THREE_R = am.load("huynh_3r")
TRUTH = THREE_R.parameters()
KS = [path for path in TRUTH if path.endswith("stiffness")]
K, D = KS[-1], KS[-1].replace("stiffness", "damping")
POSTURES: list[Any] = ["milling", [0.4, 0.9, -1.2], [-0.5, 1.6, -2.0]]
RECOVERED = 1e-6


def measured(robot: am.Robot = THREE_R, posture: Any = "milling", **options: Any) -> am.Frf:
    return am.frf(robot, posture, options.pop("freq_hz", FREQ_HZ), frame="sensor", **options)


def noisy(H: am.Frf, seed: int, noise: float | Array = 0.01) -> am.Frf:
    """With a relative error whose real and imaginary parts have the standard deviation `noise`."""
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *H.values.shape))
    return replace(H, values=H.values * (1 + noise * (real + 1j * imaginary)))


def off(robot: am.Robot, seed: int = 0, factor: float = 1.5, pattern: str = "elasticity") -> am.Robot:
    rng = np.random.default_rng(seed)
    return robot.with_values({p: v * factor ** rng.uniform(-1, 1) for p, v in robot.parameters(pattern).items()})


def errors(fit: am.Fit, truth: am.Robot = THREE_R) -> Array:
    """ln of each fitted value over the true one."""
    true = truth.numbers()
    return np.array([np.log(p.value / true[p.path]) for p in fit.parameters])


def worst(fit: am.Fit, truth: am.Robot = THREE_R) -> float:
    return float(np.abs(errors(fit, truth)).max())


def deviations(fit: am.Fit) -> Array:
    return np.array([p.deviation for p in fit.parameters])


# Ties and held numbers


def test_one_gearbox_in_two_joints_has_one_value_in_all_its_places() -> None:
    truth = THREE_R.with_values({KS[0]: 2.2e6, KS[1]: 2.2e6})
    fit = am.update(off(THREE_R), am.Measurement(measured(truth), "milling"), ties=[KS[:2]])
    assert [p.path for p in fit.parameters] == [p for p in TRUTH if p != KS[1]]
    tied = fit.parameters[0]
    assert (tied.path, tied.tied) == (KS[0], tuple(KS[:2]))
    assert worst(fit, truth) < RECOVERED
    assert fit.robot.parameters()[KS[0]] == fit.robot.parameters()[KS[1]] == tied.value
    assert all(p.tied == () for p in fit.parameters[1:])


@pytest.mark.parametrize("group", ["*.damping", ["*.z.damping"], [*[p for p in TRUTH if p.endswith("damping")]]])
def test_ties_are_named_by_patterns_as_well(group: Any) -> None:
    truth = THREE_R.with_values(dict.fromkeys((p for p in TRUTH if p.endswith("damping")), 700.0))
    fit = am.update(off(THREE_R), am.Measurement(measured(truth), "milling"), ties=[group])
    assert len(fit.parameters) == 4
    assert worst(fit, truth) < RECOVERED


def test_a_tie_is_known_better_than_its_members_alone() -> None:
    truth = THREE_R.with_values({KS[0]: 2.2e6, KS[1]: 2.2e6})
    data = am.Measurement(noisy(measured(truth), 1), "milling", weights="uniform")
    tied, apart = am.update(truth, data, ties=[KS[:2]]), am.update(truth, data)
    assert tied.parameters[0].deviation < min(p.deviation for p in apart.parameters if p.path in KS[:2])
    # A tie is a restriction: the cost cannot fall, and it grows by about as much as one parameter more explains.
    assert apart.cost < tied.cost < apart.cost + 12 * apart.noise**2


def test_a_tie_takes_the_bounds_that_all_of_it_admit() -> None:
    bounds = {KS[0]: (1e6, 5e6), KS[1]: (2e6, 4e6)}
    fit = am.update(THREE_R, am.Measurement(measured(), "milling"), ties=[KS[:2]], bounds=bounds, max_evaluations=5)
    assert (fit.parameters[0].lower, fit.parameters[0].upper) == (2e6, 4e6)


@pytest.mark.parametrize("hold", [K, [K], (K,), "links.arm.elasticity.z.stiff*", {K: 1.55e6}, {K: "1.55 MN m/rad"}])
def test_what_is_held_is_not_fitted(hold: Any) -> None:
    start = off(THREE_R).with_values({K: 1.55e6})
    fit = am.update(start, am.Measurement(measured(), "milling"), hold=hold)
    assert [p.path for p in fit.parameters] == [p for p in TRUTH if p != K]
    assert worst(fit) < RECOVERED
    assert fit.robot.parameters()[K] == 1.55e6


def test_a_mapping_holds_at_its_values_and_patterns_at_those_of_the_robot() -> None:
    data = am.Measurement(measured(), "milling")
    at_robot = am.update(THREE_R, data, hold="*.damping")
    assert at_robot.robot.parameters("damping") == THREE_R.parameters("damping")
    given = am.update(THREE_R, data, hold={D: 500.0})
    assert given.robot.parameters()[D] == 500.0
    assert given.cost > 1.0  # with a wrong damping nothing fits
    assert am.update(THREE_R, data, hold={}).parameters == am.update(THREE_R, data).parameters


# Several postures, masks, bands, weights


def test_one_set_of_parameters_fits_several_postures_and_is_known_better_for_it() -> None:
    data = [am.Measurement(noisy(measured(posture=q), i), q, weights="uniform") for i, q in enumerate(POSTURES)]
    together, alone = am.update(off(THREE_R), data), am.update(off(THREE_R), data[0])
    assert (deviations(together) < deviations(alone)).all()
    assert (np.abs(errors(together)) < 4 * deviations(together)).all()
    # Information adds up, each by its own noise.
    parts = [am.update(THREE_R, m) for m in data]
    expected = sum(fit.information * fit.noise**2 for fit in parts)
    np.testing.assert_allclose(
        together.information * together.noise**2, expected, rtol=0.05, atol=1e-3 * expected.max()
    )


def test_masked_values_have_no_say() -> None:
    H, rng = measured(), np.random.default_rng(3)
    used = rng.random(H.values.shape) > 0.2
    spoilt = replace(H, values=np.where(used, H.values, 1e3 * rng.standard_normal(H.values.shape)))
    fit = am.update(off(THREE_R), am.Measurement(spoilt, "milling", mask=used))
    assert worst(fit) < RECOVERED
    by_weight = am.Measurement(spoilt, "milling", weights=am.peak_weights(spoilt) * used)
    assert np.array_equal(by_weight.line_weights(), am.Measurement(spoilt, "milling", mask=used).line_weights())


@pytest.mark.parametrize("shape", [(150,), (1, 3, 3), (150, 1, 1), (150, 3, 3), (150, 1, 3)])
def test_a_mask_is_given_per_line_per_response_or_per_value(shape: tuple[int, ...]) -> None:
    mask = np.random.default_rng(4).random(shape) > 0.3
    weights = am.Measurement(measured(), "milling", weights="uniform", mask=mask).line_weights()
    expected = np.ones((150, 3, 3)) * (mask[:, None, None] if mask.ndim == 1 else mask)
    assert np.array_equal(weights, expected)


def test_lines_out_of_the_band_have_no_say_and_stay_in_the_figures() -> None:
    H = measured()
    outside = (FREQ_HZ < 5) | (FREQ_HZ > 15)
    spoilt = replace(H, values=np.where(outside[:, None, None], 7.0 - 2.0j, H.values))
    fit = am.update(off(THREE_R), am.Measurement(spoilt, "milling", band=(5, 15)))
    assert worst(fit) < RECOVERED
    assert len(fit.frf_after[0].freq_hz) == 150
    shorter = am.update(off(THREE_R), am.Measurement(H.band(5, 15), "milling", weights="uniform"))
    banded = am.update(off(THREE_R), am.Measurement(H, "milling", weights="uniform", band=(5, 15)))
    assert banded.start_cost == pytest.approx(shorter.start_cost, rel=1e-12)


def test_weights_per_response_count_as_often_as_they_say() -> None:
    H = noisy(measured(), 5)
    weights = np.array([[[4.0, 0, 0], [0, 1, 0], [0, 0, 0]]])
    fit = am.update(THREE_R, am.Measurement(H, "milling", weights=weights))
    xx, yy = (H.select(outputs=a, inputs=a) for a in "xy")
    twice = am.update(THREE_R, [am.Measurement(m, "milling", weights="uniform") for m in (xx, xx, xx, xx, yy)])
    assert fit.cost == pytest.approx(twice.cost, rel=1e-8)
    np.testing.assert_allclose(errors(fit), errors(twice), atol=1e-6)


# Outliers


def with_outliers(H: am.Frf, seed: int, share: float = 0.03) -> am.Frf:
    rng = np.random.default_rng([seed, 1])
    hit = rng.random(H.values.shape) < share
    gross = np.exp(rng.normal(0, 2, H.values.shape) + 1j * rng.uniform(-np.pi, np.pi, H.values.shape))
    return replace(H, values=np.where(hit, H.values * gross, H.values))


@pytest.mark.parametrize("weights", ["peaks", "uniform"])
@pytest.mark.parametrize("seed", range(3))
def test_robust_losses_see_through_gross_outliers_and_squares_do_not(seed: int, weights: str) -> None:
    clean = noisy(measured(), seed)
    spoilt, start = with_outliers(clean, seed), off(THREE_R, seed, 1.3)
    reference = am.update(start, am.Measurement(clean, "milling", weights=weights))
    data = am.Measurement(spoilt, "milling", weights=am.peak_weights(clean) if weights == "peaks" else weights)
    lost = am.update(start, data)
    assert (np.abs(errors(lost)) > 4 * deviations(reference)).any()
    for loss in ("huber", "cauchy"):
        fit = am.update(start, data, loss=loss)  # type: ignore[arg-type]
        # The truth within the intervals, which are nearly those of clean data: noise from the median, known to 2 %,
        # and 3 % of the values are gone.
        assert (np.abs(errors(fit)) < 3.5 * deviations(fit)).all()
        np.testing.assert_allclose(deviations(fit), deviations(reference), rtol=0.15)
        assert fit.noise == pytest.approx(0.01, rel=0.08)
        assert {p.verdict for p in fit.parameters} == {"identified"}
        assert fit.doubts == ()


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_a_robust_loss_costs_little_where_there_are_no_outliers(loss: Any) -> None:
    # Tuned to an efficiency of 95 %: deviations grow by 2.5 %; both see the same noise.
    data = am.Measurement(noisy(measured(), 6), "milling", weights="uniform")
    squares, robust = am.update(THREE_R, data), am.update(THREE_R, data, loss=loss)
    np.testing.assert_allclose(deviations(robust), deviations(squares), rtol=0.1)
    assert (np.abs(errors(robust) - errors(squares)) < deviations(squares)).all()


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_a_robust_loss_ends_where_its_own_equations_hold(loss: Any) -> None:
    # Σ w ψ(r) ∂r/∂x = 0 with ψ = r times the factor of the loss, the slopes by central differences.
    data = am.Measurement(with_outliers(noisy(measured(), 7), 7), "milling", weights="uniform")
    fit = am.update(THREE_R, data, loss=loss)

    def residual(step: Array) -> NDArray[np.complex128]:
        values = {p.path: p.value * float(np.exp(s)) for p, s in zip(fit.parameters, step, strict=True)}
        return np.log(measured(THREE_R.with_values(values)).values / data.frf.values)

    r = residual(np.zeros(6))
    scale = np.median(np.abs(r) / np.sqrt(2)) / np.sqrt(np.log(2))  # the median of a Rayleigh law over √2
    size = np.abs(r) / np.sqrt(2) / scale / {"huber": 1.345, "cauchy": 2.385}[loss]
    factor = 1 / np.maximum(size, 1) if loss == "huber" else 1 / (1 + size**2)
    h = 1e-5
    for j, p in enumerate(fit.parameters):
        slope = (residual(h * np.eye(6)[j]) - residual(-h * np.eye(6)[j])) / (2 * h)
        gradient = np.sum(factor * (slope.conj() * r).real)
        information = np.sum(factor * np.abs(slope) ** 2)
        # What is left of the gradient is a step of less than a twentieth of a deviation: factors settle to 1 %.
        assert abs(gradient / information) < 0.05 * p.deviation


# Coherence


def coherent(seed: int) -> tuple[am.Frf, Array]:
    """Lines whose noise goes up and down by a factor of ten, and the coherence that says so: (1 − γ²)/γ² ∝ σ²."""
    rng = np.random.default_rng([seed, 3])
    sigma = 0.01 * 10 ** np.random.default_rng(0).uniform(-0.5, 0.5, (150, 1, 1))
    H = noisy(measured(), int(rng.integers(2**31)), sigma)
    averages = 0.05  # of (1 − γ²)/γ² = 2 n σ², whatever their number n
    return H, np.broadcast_to(1 / (1 + sigma**2 / averages), H.values.shape)


def test_weights_by_coherence_scatter_less_and_their_intervals_are_right() -> None:
    draws, plain, weighted, claimed = 40, [], [], []
    for seed in range(draws):
        H, gamma2 = coherent(seed)
        without = am.Measurement(H, "milling", weights="uniform")
        plain.append(errors(am.update(THREE_R, without, method="least_squares")))
        fit = am.update(THREE_R, replace(without, coherence=gamma2), method="least_squares")
        weighted.append(errors(fit))
        claimed.append(deviations(fit))
    scatter = np.std(plain, axis=0), np.std(weighted, axis=0)
    # In mean 1/mean(1/σ²) against mean(σ²): with σ over a decade 0.39 against 2.15, a factor of 2.3 in σ; it is less
    # where few lines count.
    assert (scatter[1] < scatter[0]).all()
    assert np.median(scatter[0] / scatter[1]) > 1.3
    # A deviation from 40 draws is known to 11 %; over six parameters 4.5 %, four times which is allowed.
    z = np.array(weighted) / np.array(claimed)
    assert float(np.sqrt(np.mean(z**2))) == pytest.approx(1.0, abs=0.18)


def test_a_coherence_that_is_the_same_everywhere_changes_nothing() -> None:
    H = noisy(measured(), 8)
    plain = am.update(THREE_R, am.Measurement(H, "milling"))
    for coherence in (np.full(150, 0.7), np.ones((150, 3, 3))):
        fit = am.update(THREE_R, am.Measurement(H, "milling", coherence=coherence))
        assert fit.cost == pytest.approx(plain.cost, rel=1e-9)
        np.testing.assert_allclose(deviations(fit), deviations(plain), rtol=1e-9)


def test_values_of_no_coherence_are_left_out() -> None:
    H, gamma2 = measured(), np.full((150, 3, 3), 0.9)
    gamma2[20:30, :, 1] = 0.0
    spoilt = replace(H, values=np.where(gamma2 > 0, H.values, 9.0))
    assert worst(am.update(off(THREE_R), am.Measurement(spoilt, "milling", coherence=gamma2))) < RECOVERED


# The relative cost


def test_the_relative_cost_is_the_one_written_out_and_finds_exact_data() -> None:
    start, H = off(THREE_R), measured()
    fit = am.update(start, am.Measurement(H, "milling"), cost="relative")
    weights = am.Measurement(H, "milling").line_weights()
    by_hand = np.sum(weights * np.abs((measured(start).values - H.values) / H.values) ** 2)
    assert fit.start_cost == pytest.approx(by_hand, rel=1e-11)
    assert worst(fit) < RECOVERED


def test_both_costs_agree_on_small_noise() -> None:
    data = am.Measurement(noisy(measured(), 9, 1e-3), "milling")
    logarithmic, relative = am.update(THREE_R, data), am.update(THREE_R, data, cost="relative")
    # They differ by the square of the noise, a thousandth of a deviation's size in every residual.
    assert relative.cost == pytest.approx(logarithmic.cost, rel=0.02)
    assert (np.abs(errors(relative) - errors(logarithmic)) < 0.05 * deviations(logarithmic)).all()
    np.testing.assert_allclose(deviations(relative), deviations(logarithmic), rtol=0.01)


# Modes


def modes_of(robot: am.Robot = THREE_R, posture: Any = "milling", **options: Any) -> am.ModalMeasurement:
    found = am.modes(robot, posture)
    return am.ModalMeasurement(posture, found.natural_freq_hz, found.damping_ratio, **options)


def test_modes_alone_are_fitted_where_there_are_no_responses() -> None:
    # Frequencies and damping of one posture are as many as the parameters, and more than one robot has them.
    fit = am.update(off(THREE_R, 1, 1.3), [modes_of(posture=q) for q in POSTURES])
    assert worst(fit) < RECOVERED
    assert len(fit.postures) == 3
    assert fit.frf_after == ()
    tip = am.linearize(THREE_R, "milling").jacobian("sensor")[:3]
    shapes = (tip @ am.modes(THREE_R, "milling").shapes).T
    shaped = am.update(off(THREE_R, 2, 1.3), modes_of(shapes=shapes, frame="sensor"))
    assert worst(shaped) < RECOVERED


def test_stated_deviations_of_modes_make_the_intervals() -> None:
    # One oscillator, f = √(k/m)/2π: a relative deviation of f is half of that of k; ζ = d/2√(km), so var(ln d) is
    # var(ln ζ) + var(ln f).
    k, d = 1e5, 40.0
    zeta = d / 2 / np.sqrt(k)
    modes = am.ModalMeasurement("home", [np.sqrt(k) / 2 / np.pi], [zeta], freq_deviation=0.01, damping_deviation=0.1)
    fit = am.update(with_home(oscillator(1.0, 1.3 * k, 0.8 * d)), modes)
    stiffness, damping = fit.parameters
    np.testing.assert_allclose([stiffness.value, damping.value], [k, d], rtol=1e-6)
    np.testing.assert_allclose([stiffness.deviation, damping.deviation], [0.02, np.hypot(0.1, 0.01)], rtol=1e-6)
    # 1.96 deviations of a normal law: nothing is estimated, so nothing is Student's.
    assert stiffness.interval[1] == pytest.approx(k * np.exp(1.959964 * 0.02), rel=1e-5)


def with_home(robot: am.Robot) -> am.Robot:
    return am.Robot.from_yaml(robot.to_yaml().rstrip("}\n") + ', "postures": {"home": [0]}}')


def test_modes_and_responses_are_weighed_by_what_they_say() -> None:
    data = am.Measurement(noisy(measured(), 10), "milling", weights="uniform")
    responses = am.update(THREE_R, data)
    for size in (1e3, 1.0, 1e-2):
        modes = modes_of(freq_deviation=0.001 * size, damping_deviation=0.01 * size)
        both = am.update(off(THREE_R, factor=1.02), [data, modes])
        assert both.noise == pytest.approx(responses.noise, rel=0.05)
        alone = am.update(THREE_R, modes)
        # Information adds up, and the answer is the mean by it.
        expected = responses.information + alone.information
        np.testing.assert_allclose(both.information, expected, rtol=0.03, atol=1e-3 * np.abs(expected).max())
        mean = np.linalg.solve(expected, responses.information @ errors(responses))
        scale = np.sqrt(np.diag(np.linalg.inv(expected)))
        assert (np.abs(errors(both) - mean) < 0.1 * scale).all()
        np.testing.assert_allclose(deviations(both), scale, rtol=0.03)


# Any number

SCOMPI = am.load("scompi")
NUMBERS: dict[str, float] = {
    "links.link_3.mass": 7.5,
    "links.link_3.com.x": -0.09,
    "links.link_2.drive.shaft_stiffness": 1.8e5,
    "control.kp": 1.1e4,
    "links.link_2.drive.gear_ratio": 90.0,
    "tool.mass": 1.5,
}


def scompi_data(robot: am.Robot = SCOMPI) -> am.Measurement:
    return am.Measurement(am.frf(robot, "c8", np.arange(2, 121) / 2, frame="tool"), "c8")


@pytest.mark.parametrize("path", NUMBERS)
def test_any_number_of_the_description_is_found_back(path: str) -> None:
    truth = SCOMPI.with_values({"tool.mass": 2.0}) if path == "tool.mass" else SCOMPI
    fit = am.update(truth.with_values({path: NUMBERS[path]}), scompi_data(truth), parameters=path)
    (found,) = fit.parameters
    true = truth.numbers()[path]
    assert found.value == pytest.approx(true, rel=RECOVERED)
    assert NUMBERS[path] != pytest.approx(true, rel=0.05)
    assert found.verdict == "identified"
    assert fit.robot.numbers()[path] == found.value


def test_numbers_of_several_kinds_are_found_back_together() -> None:
    paths = list(NUMBERS)[:4]
    start = SCOMPI.with_values({path: NUMBERS[path] for path in paths})
    fit = am.update(start, scompi_data(), parameters=paths)
    true = SCOMPI.numbers()
    assert {p.path for p in fit.parameters} == set(paths)
    assert max(abs(p.value / true[p.path] - 1) for p in fit.parameters) < RECOVERED
    assert {p.scale for p in fit.parameters if p.path.endswith("com.x")} == {"linear"}


def test_mass_and_stiffness_are_fitted_beside_each_other() -> None:
    start = off(THREE_R, factor=1.2).with_values({"links.arm.mass": 1.1 * THREE_R.numbers()["links.arm.mass"]})
    fit = am.update(start, am.Measurement(measured(), "milling"), parameters=["elasticity", "links.arm.mass"])
    assert len(fit.parameters) == 7
    assert worst(fit) < RECOVERED


def two_bodies(k: float = 400.0, unseen: float = 900.0) -> am.Robot:
    """Two masses on slides of their own: the response of the first knows nothing of the second."""

    def link(name: str, axis: str, stiffness: float) -> dict[str, Any]:
        joint = {"type": "prismatic", "axis": axis}
        return {"name": name, "parent": "base", "joint": joint, "elasticity": {f"t{axis}": spring(stiffness, 2.0)},
                "mass": 1.0}  # fmt: skip

    return robot_of([link("seen", "x", k), link("hidden", "y", unseen)], postures={"home": [0, 0]})


UNSEEN: dict[str, Sequence[str]] = {
    "stiffness and damping": ["elasticity"],
    "masses too": ["elasticity", "links.*.mass"],
    "a centre of mass too": ["elasticity", "links.hidden.com.*"],
}


@pytest.mark.parametrize("what", UNSEEN)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_what_no_response_depends_on_is_named_stays_and_does_no_harm(what: str, noise: float) -> None:
    H = am.frf(two_bodies(), "home", np.arange(1, 61) / 10, frame="seen").select(outputs="x", inputs="x")
    data = am.Measurement(noisy(H, 11, noise), "home")
    start = two_bodies(k=600.0, unseen=1234.5)
    fit = am.update(start, data, parameters=UNSEEN[what])
    hidden = [p for p in fit.parameters if ".hidden." in p.path]
    assert len(hidden) >= 2
    for p in hidden:
        assert (p.verdict, p.value, p.deviation) == ("not identifiable", start.numbers()[p.path], np.inf)
        assert p.interval == ((0.0, np.inf) if p.scale == "log" else (-np.inf, np.inf))
    seen = [p for p in fit.parameters if ".seen." in p.path]
    assert {p.verdict for p in seen} == {"identified"}
    assert (fit.status, fit.evaluations < 60) == ("converged", True)
    true = two_bodies().numbers()
    for p in seen:
        assert abs(np.log(p.value / true[p.path])) < (1e-9 if noise == 0 else 4 * p.deviation)


def test_two_numbers_that_only_their_sum_shows_are_both_named() -> None:
    # A mass on a mass, with nothing between them: one body.
    def pair(first: float, second: float) -> am.Robot:
        carrier = {"name": "carrier", "parent": "base", "joint": {"type": "prismatic", "axis": "x"},
                   "elasticity": {"tx": spring(400.0, 2.0)}, "mass": first}  # fmt: skip
        load = {"name": "load", "parent": "carrier", "joint": {"type": "fixed"}, "mass": second}
        return robot_of([carrier, load], postures={"home": [0]})

    H = am.frf(pair(2.0, 1.0), "home", np.arange(1, 61) / 10, frame="carrier").select(outputs="x", inputs="x")
    fit = am.update(pair(2.5, 1.5), am.Measurement(H, "home"), parameters=["links.*.mass", "elasticity"])
    by_path = {p.path: p for p in fit.parameters}
    masses = [by_path["links.carrier.mass"], by_path["links.load.mass"]]
    assert [p.verdict for p in masses] == ["not identifiable"] * 2
    assert sum(p.value for p in masses) == pytest.approx(3.0, rel=1e-8)
    assert by_path["links.carrier.elasticity.tx.stiffness"].verdict == "identified"
    assert (fit.status, fit.evaluations < 60) == ("converged", True)
