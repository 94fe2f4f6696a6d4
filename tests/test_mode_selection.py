"""Modes out of stabilizations whose truth is known: scattered poles, gaps, false poles, close modes, combinations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

import armonic as am
from armonic.errors import SignalError
from armonic.identification.clustering import select_modes
from armonic.identification.grid_search import grid_search
from armonic.identification.poles import ModelPoles, continuous_poles, kept_poles
from armonic.identification.stabilization import Criteria, stabilize

TURN = 2 * np.pi
CHANNELS = 6


def cluster(stabilization, **options):
    return list(select_modes(stabilization, **options).modes)


def pole(freq_hz, damping):
    return TURN * freq_hz * (-damping + 1j * np.sqrt(1 - damping**2))


def shape_of(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=CHANNELS) + 1j * rng.normal(size=CHANNELS)


class Truth:
    """A mode and how an identification sees it: relative scatter of its pole, scatter of its shape, orders it is in."""

    def __init__(self, freq_hz, damping, *, shape=None, scatter=1e-4, blur=1e-3, held=1.0, first=0):
        self.freq_hz, self.damping, self.pole = freq_hz, damping, pole(freq_hz, damping)
        self.shape = shape_of(int(1000 * freq_hz + 1e5 * damping)) if shape is None else shape
        self.scatter, self.blur, self.held, self.first = scatter, blur, held, first


def models_of(truths, *, seed=0, orders=range(2, 61), false_per_order=2.0, nyquist_hz=200.0):
    """Poles of every order: the true ones with their scatter, and false ones anywhere, more at higher orders."""
    rng = np.random.default_rng(seed)

    def complex_normal(*size):
        return (rng.normal(size=size) + 1j * rng.normal(size=size)) / np.sqrt(2)

    models = []
    for p in orders:
        seen = [t for t in truths if p >= t.first and rng.random() < t.held]
        poles = [t.pole * (1 + t.scatter * complex_normal()) for t in seen]
        shapes = [
            (t.shape / np.linalg.norm(t.shape) + t.blur * complex_normal(CHANNELS)) * 3 * complex_normal() for t in seen
        ]
        false = int(false_per_order * p)
        # False poles of an autoregression lie evenly over frequency, most of them slightly damped, some growing.
        rate = rng.exponential(0.03 * TURN * nyquist_hz, false) - 0.005 * TURN * nyquist_hz
        poles.extend(-rate + 1j * TURN * rng.uniform(0, nyquist_hz, false))
        shapes.extend(complex_normal(false, CHANNELS))
        mixed = rng.permutation(len(poles))
        models.append(
            ModelPoles(
                p,
                np.array(poles, complex).reshape(-1)[mixed],
                np.array(shapes, complex).reshape(-1, CHANNELS)[mixed],
            )
        )
    return models


def names(modes):
    return [(round(mode.natural_freq_hz, 1), round(mode.damping_ratio, 2)) for mode in modes]


def alike(mode, truth):
    return float(am.mac(mode.shape[:, None], truth.shape[:, None])[0, 0])


ROBOT = [
    Truth(6.37, 0.077),
    Truth(6.96, 0.113),
    Truth(12.72, 0.162),
    Truth(25.59, 0.266, scatter=1e-3),
    Truth(37.02, 0.014),
    Truth(58.38, 0.030),
    Truth(58.86, 0.035),
    Truth(183.2, 0.170, scatter=3e-3),
]


# --- Clustering ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_every_mode_is_found_among_false_poles_and_nothing_else(seed):
    modes = cluster(stabilize(models_of(ROBOT, seed=seed)))
    assert len(modes) == len(ROBOT)
    for mode, truth in zip(modes, ROBOT, strict=True):
        # The mean of some 45 of 59 poles that scatter by scatter/√2 in either direction: 6 standard errors, since
        # leaving out poles costs some of the precision of a plain mean.
        tolerance = 6 * truth.scatter / np.sqrt(2) / np.sqrt(45)
        assert abs(mode.pole / truth.pole - 1) < tolerance
        assert mode.natural_freq_hz == pytest.approx(abs(mode.pole) / TURN, rel=1e-14)
        assert mode.damping_ratio == pytest.approx(-mode.pole.real / abs(mode.pole), rel=1e-14)
        assert alike(mode, truth) > 1 - 1e-5  # blur squared is 1e-6 per channel before averaging
        assert np.linalg.norm(mode.shape) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_false_poles_alone_give_no_mode(seed):
    assert cluster(stabilize(models_of([], seed=seed))) == []


@pytest.mark.parametrize("channels", [1, 2, 3, 6])
def test_white_noise_has_no_modes(channels):
    values = np.random.default_rng(channels).normal(size=(2000, channels))
    models = autoregressive_poles(values, 1000.0, range(2, 26))
    assert cluster(stabilize(list(models))) == []


@pytest.mark.parametrize("seed", range(3))
def test_resonances_driven_by_noise_are_found_and_nothing_else(seed):
    rate_hz, seconds, resonances = 1000.0, 3.0, [(20.0, 0.03), (50.0, 0.02), (120.0, 0.05)]
    rng = np.random.default_rng(seed)
    motion = []
    for freq_hz, damping in resonances:
        mu = np.exp(pole(freq_hz, damping) / rate_hz)
        motion.append(lfilter([1.0], [1.0, -2 * mu.real, abs(mu) ** 2], rng.normal(size=int(rate_hz * seconds))))
    motion = np.column_stack([x / x.std() for x in motion])
    noise = 0.1 * rng.normal(size=(len(motion), CHANNELS))
    values = motion @ np.random.default_rng(7).normal(size=(3, CHANNELS)) + noise
    modes = cluster(stabilize(list(autoregressive_poles(values, rate_hz, range(2, 31)))))
    assert len(modes) == 3
    for mode, (freq_hz, damping) in zip(modes, resonances, strict=True):
        # Standard deviations of the maximum likelihood estimate from so many cycles; five of them.
        cycles = TURN * freq_hz * seconds
        assert mode.natural_freq_hz == pytest.approx(freq_hz, rel=5 * np.sqrt(damping / (2 * cycles)))
        assert mode.damping_ratio == pytest.approx(damping, abs=5 * np.sqrt(damping / cycles))


def test_no_poles_at_all_give_no_mode():
    assert cluster(stabilize(models_of([], false_per_order=0.0))) == []
    assert grid_search(stabilize(models_of([], false_per_order=0.0))) == []


@pytest.mark.parametrize(
    "pair",
    [
        pytest.param([Truth(50.0, 0.02), Truth(50.5, 0.02)], id="1 % apart"),
        pytest.param([Truth(50.0, 0.02, shape=shape_of(1)), Truth(50.5, 0.02, shape=shape_of(1))], id="of one shape"),
        pytest.param(
            [Truth(50.0, 0.02, shape=shape_of(1)), Truth(50.0, 0.04, shape=shape_of(1))], id="of two dampings"
        ),
        pytest.param([Truth(50.0, 0.02, shape=shape_of(i)) for i in (1, 2)], id="of one pole and two shapes"),
    ],
)
def test_two_close_modes_stay_two(pair):
    modes = cluster(stabilize(models_of(pair, seed=3)))
    assert len(modes) == 2
    found = [
        max(modes, key=lambda mode, truth=truth: alike(mode, truth) - abs(mode.pole / truth.pole - 1)) for truth in pair
    ]
    assert found[0] is not found[1]
    for mode, truth in zip(found, pair, strict=True):
        # A pole of the other mode may stand in for a missing one; the mean of the core is that of a single mode.
        assert abs(mode.pole / truth.pole - 1) < 1e-4
        assert alike(mode, truth) > 0.9999


@pytest.mark.parametrize("seed", range(5))
def test_a_mode_damped_by_80_percent_that_scatters_by_3_percent_is_found(seed):
    truth = Truth(150.0, 0.8, scatter=0.03)
    modes = [m for m in cluster(stabilize(models_of([*ROBOT, truth], seed=seed))) if m.damping_ratio > 0.5]
    assert len(modes) == 1
    assert abs(modes[0].pole / truth.pole - 1) < 5 * 0.03 / np.sqrt(30)
    # The scatter of |λ|, from some 50 poles: 1.4826 MAD has a standard error of 1.17/√50 = 17 %; three of them.
    assert modes[0].freq_std_hz == pytest.approx(150.0 * 0.03 / np.sqrt(2), rel=0.5)


def test_a_mode_missing_in_half_of_the_orders_is_found_and_counted():
    truth = Truth(37.0, 0.02, held=0.5)
    modes = cluster(stabilize(models_of([truth], seed=1)))
    assert names(modes) == [(37.0, 0.02)]
    # Binomial: half of 59, standard deviation 3.8.
    assert 18 <= modes[0].orders <= 41
    assert modes[0].orders == len(modes[0].members)


def test_a_mode_seen_in_two_of_three_orders_is_found_and_one_of_every_third_if_asked_for():
    orders = range(2, 62)
    models = models_of([], seed=2, orders=orders)
    for i in range(60):
        old, added = models[i], [pole(20.0, 0.05)] if i % 3 else [pole(31.0, 0.03)]
        models[i] = ModelPoles(old.order, np.append(old.poles, added), np.vstack([old.shapes, shape_of(1)]))
    modes = cluster(stabilize(models))
    assert names(modes) == [(20.0, 0.05)]
    assert modes[0].orders == 40
    assert (31.0, 0.03) in names(cluster(stabilize(models), least_share=1 / 3))


def test_a_mode_held_by_too_few_orders_is_not_one_until_fewer_are_asked_for():
    late = Truth(37.0, 0.02, first=48)  # in 13 of the orders 2 to 60
    stabilization = stabilize(models_of([late], seed=4))
    assert cluster(stabilization) == []
    modes = cluster(stabilization, least_share=0.2)
    assert (37.0, 0.02) in names(modes)
    assert next(m for m in modes if round(m.natural_freq_hz) == 37).first_order == 48


def test_what_grows_or_does_not_oscillate_is_no_mode_however_steady():
    steady = np.array([-30.0, TURN * 10 * (0.01 + 1j), -TURN * 5 + 1e-9j], complex)
    shapes = np.array([shape_of(i) for i in range(3)])
    models = [ModelPoles(p, steady, shapes) for p in range(2, 20)]
    assert cluster(stabilize(models)) == []
    assert grid_search(stabilize(models, Criteria(damping_range=None)), only_stable=False) == []


def test_poles_without_a_shape_are_left_out():
    models = [ModelPoles(p, np.array([pole(10.0, 0.1)]), np.full((1, 2), np.nan + 0j)) for p in range(2, 20)]
    assert cluster(stabilize(models)) == []


def test_orders_that_are_off_do_not_shift_a_mode():
    truth = Truth(40.0, 0.03, scatter=1e-5)
    models = models_of([truth], seed=5, false_per_order=0.0)
    for i in range(0, 12):  # a fifth of them, all to one side
        models[i] = ModelPoles(models[i].order, models[i].poles * 1.01, models[i].shapes)
    (mode,) = cluster(stabilize(models))
    assert mode.orders == len(models)
    assert abs(mode.pole / truth.pole - 1) < 5e-6  # half the scatter of one order; the plain mean is off by 2e-3


def test_modes_do_not_depend_on_the_order_of_poles_within_a_model():
    models = models_of(ROBOT, seed=6)
    turned = [ModelPoles(m.order, m.poles[::-1], m.shapes[::-1]) for m in models]
    a, b = cluster(stabilize(models)), cluster(stabilize(turned))
    np.testing.assert_allclose([m.pole for m in a], [m.pole for m in b], rtol=1e-12)


def test_members_are_poles_of_different_orders_near_the_mode():
    stabilization = stabilize(models_of(ROBOT, seed=7))
    modes = cluster(stabilization)
    everything = np.concatenate([mode.members for mode in modes])
    assert len(set(everything.tolist())) == len(everything)
    for mode in modes:
        orders = stabilization.order[mode.members]
        assert (np.diff(orders) > 0).all()
        assert mode.first_order == orders[0]
        assert np.median(abs(stabilization.pole[mode.members] / mode.pole - 1)) < 0.01


@settings(max_examples=25, deadline=None)
@given(st.floats(2.0, 150.0), st.floats(0.003, 0.5), st.floats(1e-3, 1e3), st.integers(0, 10**6))
def test_one_mode_is_found_wherever_it_lies_and_at_any_scale_of_time(freq_hz, damping, scale, seed):
    truth = Truth(freq_hz, damping)
    models = models_of([truth], seed=seed, orders=range(2, 32))
    scaled = [ModelPoles(m.order, m.poles * scale, m.shapes) for m in models]
    modes = cluster(stabilize(scaled), combinations=False)
    assert any(abs(mode.pole / (truth.pole * scale) - 1) < 1e-3 for mode in modes)


# --- Combinations -------------------------------------------------------------------------------------------


def test_sums_and_differences_of_modes_are_rejected_with_their_parents_named():
    a, b = Truth(6.37, 0.077), Truth(37.02, 0.014)
    false = [
        (2 * a.pole, "twice the pole of the mode at 6.37 Hz"),
        (b.pole + a.pole.conjugate(), "difference of the modes at 37.02 and 6.37 Hz"),
        (a.pole + b.pole, "sum of the modes at "),
    ]
    echoes = [Truth(abs(p) / TURN, -p.real / abs(p), first=8) for p, _ in false]
    selection = select_modes(stabilize(models_of([a, b, *echoes], seed=1)))
    assert names(selection.modes) == [(6.4, 0.08), (37.0, 0.01)]
    for (_, words), mode in zip(false, selection.rejected, strict=True):
        assert words in mode.reason
        assert "6.37" in mode.reason
    assert len(cluster(stabilize(models_of([a, b, *echoes], seed=1)), combinations=False)) == 5


def test_a_mode_at_twice_the_frequency_with_a_damping_of_its_own_is_kept():
    modes = cluster(stabilize(models_of([Truth(10.0, 0.05), Truth(20.0, 0.03, first=8)], seed=2)))
    assert names(modes) == [(10.0, 0.05), (20.0, 0.03)]


def test_a_mode_that_more_orders_hold_than_its_would_be_parents_is_kept():
    parents = [Truth(10.0, 0.05, first=20), Truth(25.0, 0.02, first=20)]
    total = parents[0].pole + parents[1].pole
    strong = Truth(abs(total) / TURN, -total.real / abs(total))
    assert len(cluster(stabilize(models_of([*parents, strong], seed=3)))) == 3


def nonlinear_decay(samples=1500, rate_hz=200.0):
    """A chain of two masses whose first spring changes with its stretch, let go from rest; and its linear poles."""
    stiffness = np.array([[9000.0, -3000.0], [-3000.0, 3000.0]])
    damping = 4e-4 * stiffness + 0.3 * np.eye(2)
    softening = 40000.0

    def rate(_, y):
        spring = np.array([softening * y[0] ** 2, 0.0])
        return np.concatenate([y[2:], -stiffness @ y[:2] - damping @ y[2:] - spring])

    # Quadratic terms are 1 % of the motion; tones of three modes, 1e-4 of it, stay below the noise added.
    times = np.arange(samples) / rate_hz
    run = solve_ivp(rate, (0, times[-1]), [0.002, -0.001, 0, 0], "DOP853", times, rtol=1e-12, atol=1e-15)
    linear = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]]))
    values = run.y[:2].T + 1e-9 * np.random.default_rng(0).normal(size=(samples, 2))
    return values, rate_hz, np.sort_complex(linear[linear.imag > 0])


def autoregressive_poles(values, rate_hz, orders):
    """Least squares and companion matrices, as plain as can be."""
    m = values.shape[1]
    for p in orders:
        lags = np.hstack([values[p - k : len(values) - k] for k in range(1, p + 1)])
        coefficients = np.linalg.lstsq(lags, values[p:], rcond=1e-14)[0].T
        companion = np.vstack([coefficients, np.eye(m * (p - 1), m * p)])
        discrete, vectors = np.linalg.eig(companion)
        keep = kept_poles(discrete)
        yield ModelPoles(p, continuous_poles(discrete[keep], rate_hz), vectors[-m:, keep].T)


def test_the_modes_of_a_nonlinear_chain_are_told_from_its_combination_tones():
    values, rate_hz, linear = nonlinear_decay()
    selection = select_modes(stabilize(list(autoregressive_poles(values, rate_hz, range(2, 26)))))
    found = np.sort_complex(np.array([mode.pole for mode in selection.modes]))
    assert len(found) == 2
    np.testing.assert_allclose(found, linear, rtol=1e-3)  # what cubic terms leave of the amplitude's square
    assert len(selection.rejected) >= 1
    for mode in selection.rejected:
        tones = [a + b for a in linear for b in (*linear, *linear.conj())]
        assert min(abs(mode.pole - tone) for tone in tones) < 0.01 * abs(mode.pole)


# --- Grid search --------------------------------------------------------------------------------------------


def test_the_grid_finds_modes_that_stay_within_its_resolution():
    modes = grid_search(stabilize(models_of(ROBOT, seed=0)), repeats=40)
    kept = [truth for truth in ROBOT if truth.scatter * truth.freq_hz < 0.02]
    assert names(modes) == [(round(t.freq_hz, 1), round(t.damping, 2)) for t in kept]
    for mode, truth in zip(modes, kept, strict=True):
        assert abs(mode.pole / truth.pole - 1) < 1e-4


@pytest.mark.parametrize("offset", [0.0, 0.013, 0.05, 0.087])
def test_the_grid_has_no_lines_that_cut_a_mode(offset):
    truth = Truth(30.0 + offset, 0.0205, scatter=3e-4)
    (mode,) = grid_search(stabilize(models_of([truth], seed=1, false_per_order=0.0)))
    assert mode.orders > 55  # poles scatter by 0.006 Hz and 2e-4; the cell reaches 0.05 Hz and 5e-4 to each side


def test_a_mode_repeats_as_often_as_asked_or_is_none():
    models = [ModelPoles(p, np.array([pole(30.0, 0.02)]), shape_of(1)[None]) for p in range(2, 12)]
    stabilization = stabilize(models)
    assert len(grid_search(stabilization, repeats=9)) == 1  # the first order has no partner, so it is not stable
    assert grid_search(stabilization, repeats=10) == []
    assert grid_search(stabilization, repeats=10, only_stable=False)[0].orders == 10


def test_two_modes_are_two_or_one_depending_on_the_resolution():
    shape = shape_of(1)
    stabilization = stabilize(
        models_of(
            [Truth(30.0, 0.02, shape=shape, scatter=1e-5), Truth(30.3, 0.02, shape=shape, scatter=1e-5)],
            false_per_order=0.0,
        )
    )
    assert names(grid_search(stabilization)) == [(30.0, 0.02), (30.3, 0.02)]
    assert len(grid_search(stabilization, freq_resolution_hz=1.0)) == 1


# --- Bad input ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, np.nan])
def test_a_share_of_orders_outside_zero_to_one_is_refused(share):
    with pytest.raises(SignalError, match="least_share"):
        cluster(stabilize(models_of(ROBOT)), least_share=share)


def test_two_orders_are_too_few_to_tell_what_holds():
    with pytest.raises(SignalError, match="at least three"):
        cluster(stabilize(models_of(ROBOT, orders=[2, 3])))


@pytest.mark.parametrize(
    "setting",
    [
        {"freq_resolution_hz": 0.0},
        {"damping_resolution": -1.0},
        {"repeats": 1},
        {"repeats": 60},
        {"freq_resolution_hz": np.inf},
    ],
)
def test_a_grid_without_a_size_or_with_more_repeats_than_orders_is_refused(setting):
    with pytest.raises(SignalError, match=next(iter(setting))):
        grid_search(stabilize(models_of(ROBOT)), **setting)
