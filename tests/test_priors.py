"""What is known beforehand counts as data of its deviation: against the normal equations, written out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import armonic as am
from armonic.updating import Prior
from models import oscillator, robot_of, spring

Array = NDArray[np.float64]

FREQ_HZ = np.arange(1, 101) / 4
ROBOT = am.load("huynh_3r")
TRUTH = ROBOT.parameters()
PATHS = list(TRUTH)
NOISE = 0.01


def noisy(H: am.Frf, seed: int, noise: float = NOISE) -> am.Frf:
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *H.values.shape))
    return replace(H, values=H.values * (1 + noise * (real + 1j * imaginary)))


def measured(seed: int, noise: float = NOISE, **options: Any) -> am.Measurement:
    H = am.frf(ROBOT, "milling", FREQ_HZ, frame="sensor")
    return am.Measurement(noisy(H, seed, noise), "milling", **{"weights": "uniform"} | options)


def logarithms(robot: am.Robot, frf: am.Frf) -> NDArray[np.complex128]:
    """ln of the model over the measured responses, flat."""
    found = am.frf(robot, "milling", frf.freq_hz, frame="sensor").values / frf.values
    return np.asarray(np.log(found)).ravel()


def slopes(frf: am.Frf) -> Array:
    """∂ ln H/∂ ln p at the truth by central differences, real parts over imaginary ones, (rows, 6)."""
    h, columns = 1e-5, []
    for path in PATHS:
        up, down = (logarithms(ROBOT.with_values({path: TRUTH[path] * np.exp(s)}), frf) for s in (h, -h))
        columns.append((up - down) / (2 * h))
    J = np.stack(columns, axis=1)
    return np.concatenate([J.real, J.imag])


def errors(fit: am.Fit) -> Array:
    return np.array([np.log(p.value / TRUTH[p.path]) for p in fit.parameters])


@pytest.mark.parametrize("sure", [1e-4, 1e-3, 1e-2, 1.0])
@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_the_estimate_is_the_most_probable_one_of_the_linear_problem(sure: float, shift: float) -> None:
    # So little noise that responses are linear over the errors: x = A⁻¹ b with A = JᵀJ/σ² + 1/δ², b = Jᵀr/σ² + m/δ².
    data = measured(1)
    mean = shift * sure * np.array([1.0, -1.0, 0.5, 0.0, 1.0, -0.5])
    priors = {p: Prior(sure, TRUTH[p] * float(np.exp(m))) for p, m in zip(PATHS, mean, strict=True)}
    fit = am.update(ROBOT, data, priors=priors)
    J, r = slopes(data.frf), logarithms(ROBOT, data.frf)
    A = J.T @ J / fit.noise**2 + np.eye(6) / sure**2
    b = -J.T @ np.concatenate([r.real, r.imag]) / fit.noise**2 + mean / sure**2
    expected, deviation = np.linalg.solve(A, b), np.sqrt(np.diag(np.linalg.inv(A)))
    # The noise behind the weight of priors settles to 1 %, and second orders are a per cent of a deviation.
    assert (np.abs(errors(fit) - expected) < 0.03 * deviation).all()
    np.testing.assert_allclose([p.deviation for p in fit.parameters], deviation, rtol=0.02)
    np.testing.assert_allclose(fit.information, A, rtol=0.02, atol=1e-3 * A.max())
    assert fit.noise == pytest.approx(NOISE, rel=0.05)


def branches(k: float = 400.0, hidden: float = 900.0) -> am.Robot:
    """Two masses on slides of their own; the response of the first does not depend on the second."""
    links = [
        {"name": name, "parent": "base", "joint": {"type": "prismatic", "axis": axis},
         "elasticity": {f"t{axis}": spring(stiffness, 2.0)}, "mass": 1.0}
        for name, axis, stiffness in (("seen", "x", k), ("hidden", "y", hidden))
    ]  # fmt: skip
    return robot_of(links, postures={"home": [0, 0]})


HIDDEN = "links.hidden.elasticity.ty.stiffness"


@pytest.mark.parametrize("weights", ["uniform", "peaks"])
@pytest.mark.parametrize("noise", [0.001, 0.05])
@pytest.mark.parametrize("sure", [0.05, 0.5])
def test_where_the_data_say_nothing_the_prior_is_all_there_is(sure: float, noise: float, weights: str) -> None:
    H = am.frf(branches(), "home", FREQ_HZ, frame="seen").select(outputs="x", inputs="x")
    data = am.Measurement(noisy(H, 2, noise), "home", weights=weights)
    fit = am.update(branches(500.0, 700.0), data, parameters="stiffness", priors={HIDDEN: Prior(sure, 1000.0)})
    seen, hidden = fit.parameters
    assert hidden.value == pytest.approx(1000.0, rel=1e-6)
    assert hidden.deviation == pytest.approx(sure, rel=1e-6)
    # Student's factor for the 199 degrees of freedom of the noise is 1.972, for 200 it is 1.96 to 0.6 %.
    assert np.log(hidden.interval[1] / 1000.0) == pytest.approx(1.972 * sure, rel=0.002)
    assert hidden.verdict == ("identified" if sure < 0.1 else "weak")
    alone = am.update(branches(500.0, 700.0), data, parameters="stiffness")
    assert seen.value == pytest.approx(alone.parameters[0].value, rel=1e-7)
    assert seen.deviation == pytest.approx(alone.parameters[0].deviation, rel=1e-6)
    assert alone.parameters[1].verdict == "not identifiable"


def test_a_number_is_a_relative_deviation_about_the_value_of_the_robot() -> None:
    data, start = measured(3), ROBOT.with_values({PATHS[0]: 2.1e6})
    one = am.update(start, data, priors={PATHS[0]: 1e-3})
    other = am.update(start, data, priors={PATHS[0]: Prior(1e-3, 2.1e6)})
    assert np.array_equal(errors(one), errors(other))
    free = am.update(start, data)
    assert errors(free)[0] < errors(one)[0] < np.log(2.1e6 / TRUTH[PATHS[0]])


def test_patterns_give_priors_to_many_and_later_ones_win() -> None:
    data = measured(4)
    many = am.update(ROBOT, data, priors={"stiffness": 0.01, "*.damping": 0.1})
    each = am.update(ROBOT, data, priors={p: 0.01 if p.endswith("stiffness") else 0.1 for p in PATHS})
    assert np.array_equal(errors(many), errors(each))
    won = am.update(ROBOT, data, priors={"stiffness": 0.5, PATHS[0]: 1e-5})
    assert won.parameters[0].deviation == pytest.approx(1e-5, rel=0.01)


def test_of_numbers_that_are_tied_the_first_one_gives_the_expectation() -> None:
    start = ROBOT.with_values({PATHS[0]: 2.0e6, PATHS[2]: 2.4e6})
    same = ROBOT.with_values({PATHS[0]: 2.0e6, PATHS[2]: 2.0e6})
    H = am.frf(same, "milling", FREQ_HZ, frame="sensor")
    data = am.Measurement(noisy(H, 5), "milling", weights="uniform")
    fit = am.update(start, data, ties=[[PATHS[0], PATHS[2]]], priors={"stiffness": 1e-6})
    assert fit.parameters[0].value == pytest.approx(2.0e6, rel=1e-5)


def test_a_prior_of_a_linear_number_is_its_standard_deviation_itself() -> None:
    robot = am.load("scompi")
    path = "links.link_3.com.x"  # -0.138 m
    H = am.frf(robot, "c8", FREQ_HZ, frame="tool").select(outputs="x", inputs="x")
    data = am.Measurement(noisy(H, 6), "c8", weights="uniform")
    fit = am.update(robot, data, parameters=path, priors={path: Prior(1e-4, -0.130)})
    (found,) = fit.parameters
    (alone,) = am.update(robot, data, parameters=path).parameters
    half = (alone.interval[1] - alone.interval[0]) / 2 / 1.97
    weight = np.array([1 / half**2, 1 / 1e-4**2])
    expected = weight @ [alone.value, -0.130] / weight.sum()
    # The centre of mass moves by a fifth of the distance, over which the response bends.
    assert found.value == pytest.approx(expected, abs=0.1 * abs(alone.value + 0.130))
    near = am.update(robot, data, parameters=path, priors={path: Prior(1e-6, alone.value)}).parameters[0]
    assert (near.interval[1] - near.interval[0]) / 2 == pytest.approx(1.97e-6, rel=0.02)


def test_priors_make_up_for_data_that_are_fewer_than_the_parameters() -> None:
    # One value, two parts, for stiffness and damping and mass: the mass is known beforehand.
    H = am.frf(oscillator(2.0, 400.0, 3.0), [0.0], [2.0], frame="mass_0").select(outputs="x", inputs="x")
    start = oscillator(2.0, 500.0, 2.0)
    names = ["elasticity", "links.mass_0.mass"]
    with pytest.raises(am.UpdateError, match=r"found 2 numbers for 3 parameters, .*give priors"):
        am.update(start, am.Measurement(H, [0.0]), parameters=names)
    fit = am.update(start, am.Measurement(H, [0.0], weights="uniform"), parameters=names, priors={"links.*.mass": 0.01})
    by_path = {p.path: p.value for p in fit.parameters}
    # k − m ω² and c as measured, m as expected.
    assert by_path["links.mass_0.elasticity.tx.damping"] == pytest.approx(3.0, rel=1e-6)
    assert by_path["links.mass_0.elasticity.tx.stiffness"] == pytest.approx(400.0, rel=1e-6)
    assert by_path["links.mass_0.mass"] == pytest.approx(2.0, rel=1e-6)


def test_priors_count_in_a_robust_fit_and_beside_coherence_as_they_should() -> None:
    rng = np.random.default_rng(7)
    sigma = NOISE * 10 ** rng.uniform(-0.7, 0.7, (len(FREQ_HZ), 1, 1))
    H = am.frf(ROBOT, "milling", FREQ_HZ, frame="sensor")
    real, imaginary = rng.standard_normal((2, *H.values.shape))
    H = replace(H, values=H.values * (1 + sigma * (real + 1j * imaginary)))
    coherence = np.broadcast_to(1 / (1 + sigma**2 / 0.05), H.values.shape)
    J, r = slopes(H), logarithms(ROBOT, H)
    every = np.broadcast_to(1 / sigma**2, H.values.shape).ravel()
    W = np.concatenate([every, every])
    sure = 2e-4
    A = J.T @ (W[:, None] * J) + np.eye(6) / sure**2
    expected = np.linalg.solve(A, -J.T @ (W * np.concatenate([r.real, r.imag])))
    deviation = np.sqrt(np.diag(np.linalg.inv(A)))
    data = am.Measurement(H, "milling", weights="uniform", coherence=coherence)
    fit = am.update(ROBOT, data, priors=dict.fromkeys(PATHS, sure))
    # The noise is estimated, and by it the weight of priors: to 3 %; and a tenth of noise in some lines is curved.
    assert (np.abs(errors(fit) - expected) < 0.2 * deviation).all()
    np.testing.assert_allclose([p.deviation for p in fit.parameters], deviation, rtol=0.05)
    for loss in ("huber", "cauchy"):
        robust = am.update(ROBOT, data, priors=dict.fromkeys(PATHS, sure), loss=loss)  # type: ignore[arg-type]
        assert (np.abs(errors(robust) - expected) < 0.6 * deviation).all()
        np.testing.assert_allclose([p.deviation for p in robust.parameters], deviation, rtol=0.1)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("sure", "found 'sure', expected a positive standard deviation"),
        (None, "found None, expected a positive standard deviation"),
        (True, "found True, expected a positive standard deviation"),
        (0.0, "found 0.0, expected a positive standard deviation"),
        (-0.1, "found -0.1"),
        (np.nan, "found nan"),
        (np.inf, "found inf"),
        (1j, "found 1j"),
        ((0.1, 2e6), r"found \(0.1, 2000000.0\), expected a positive standard deviation, or Prior"),
        (Prior("a"), r"found Prior\(deviation='a'"),  # type: ignore[arg-type]
        (Prior(0.1, "a"), "found 'a', expected a finite value"),  # type: ignore[arg-type]
        (Prior(0.1, np.nan), "found nan, expected a finite value"),
        (Prior(0.1, -2.0), "found -2, expected a positive value"),
        (Prior(0.1, 0.0), "found 0, expected a positive value"),
        (1e-9, "found a standard deviation of 1e-09, expected at least 1e-06. What is known so well is better held"),
    ],
)
def test_priors_that_say_nothing_are_refused_in_one_line(given: Any, message: str) -> None:
    with pytest.raises(am.UpdateError, match=message) as caught:
        am.update(ROBOT, measured(8), priors={PATHS[0]: given})
    assert str(caught.value).startswith(f"prior of {PATHS[0]}: found")
    assert "\n" not in str(caught.value)


def test_priors_of_what_is_not_fitted_are_refused() -> None:
    for path in ("links.arm.mass", PATHS[0]):
        with pytest.raises(am.UpdateError, match=f"prior of {path}: found a number that is not fitted"):
            am.update(ROBOT, measured(9), priors={path: 0.1}, hold=PATHS[0])
    with pytest.raises(am.UpdateError, match="priors: found 'nothing', expected the path"):
        am.update(ROBOT, measured(9), priors={"nothing": 0.1})
