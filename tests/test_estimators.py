"""H1, H2 and Hv have the biases that theory gives them, and coherence is what noise leaves of it."""

from __future__ import annotations

import numpy as np
import pytest

from armonic.errors import SignalError
from armonic.experiment.estimators import frf_estimate

H = 2.0 - 1.5j
AVERAGES = 40_000
"""Of one line: means scatter by half a percent."""


def noise(rng: np.random.Generator, power: float, *shape: int) -> np.ndarray:
    return np.sqrt(power / 2) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))


def one_force(force_noise: float, response_noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Spectra of unit force, with noise as shares of the powers of force and response."""
    rng = np.random.default_rng(seed)
    true = noise(rng, 1.0, AVERAGES, 1, 1)
    forces = true + noise(rng, force_noise, AVERAGES, 1, 1)
    return forces, H * true + noise(rng, response_noise * abs(H) ** 2, AVERAGES, 1, 1)


def close(found: np.ndarray, expected: complex) -> None:
    assert abs(found.item() / expected - 1) < 0.02  # four standard deviations of 40 000 averages


@pytest.mark.parametrize(("force_noise", "response_noise"), [(0.0, 0.3), (0.3, 0.0), (0.2, 0.2)])
def test_each_estimator_has_its_bias(force_noise: float, response_noise: float) -> None:
    spectra = one_force(force_noise, response_noise)
    close(frf_estimate(*spectra, "H1")[0], H / (1 + force_noise))
    close(frf_estimate(*spectra, "H2")[0], H * (1 + response_noise))
    if force_noise == response_noise:
        close(frf_estimate(*spectra, "Hv")[0], H)


def test_hv_lies_between_the_other_two() -> None:
    spectra = one_force(0.1, 0.4)
    h1, hv, h2 = (abs(frf_estimate(*spectra, name)[0].item()) for name in ("H1", "Hv", "H2"))  # type: ignore[arg-type]
    assert h1 < hv < h2


@pytest.mark.parametrize(("force_noise", "response_noise"), [(0.0, 0.5), (0.5, 0.0), (0.3, 0.2)])
def test_coherence_is_what_noise_leaves(force_noise: float, response_noise: float) -> None:
    _, coherence = frf_estimate(*one_force(force_noise, response_noise))
    # Bendat and Piersol 2010, section 9.1: the shares of signal in force and response, multiplied
    assert coherence.item() == pytest.approx(1 / ((1 + force_noise) * (1 + response_noise)), abs=0.01)


@pytest.mark.parametrize("estimator", ["H1", "Hv"])
def test_two_forces_that_are_partly_alike_are_told_apart(estimator: str) -> None:
    rng = np.random.default_rng(1)
    forces = noise(rng, 1.0, 30, 5, 2)
    forces[:, :, 1] += 0.7 * forces[:, :, 0]
    true = noise(rng, 1.0, 5, 3, 2)
    found, coherence = frf_estimate(forces, np.einsum("loi,nli->nlo", true, forces), estimator)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, true, rtol=1e-6)  # Hv squares the condition of both forces
    np.testing.assert_allclose(coherence, 1.0, atol=1e-9)


def test_what_makes_no_estimate_is_refused() -> None:
    rng = np.random.default_rng(2)
    forces = noise(rng, 1.0, 10, 4, 2)
    responses = noise(rng, 1.0, 10, 4, 1)
    with pytest.raises(SignalError, match="one of H1, H2, Hv"):
        frf_estimate(forces, responses, "H3")  # type: ignore[arg-type]
    with pytest.raises(SignalError, match="H2 with several forces"):
        frf_estimate(forces, responses, "H2")
    with pytest.raises(SignalError, match="at least 2"):
        frf_estimate(forces[:1], responses[:1])
    forces[:, :, 1] = 2 * forces[:, :, 0]
    with pytest.raises(SignalError, match="one and the same"):
        frf_estimate(forces, responses)
