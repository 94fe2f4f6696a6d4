"""A run that was broken off goes on from its checkpoint to the same bits, on any number of threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armonic as am
from armonic.updating import Law, Prior
from robot_files import START

FREQ_HZ = np.arange(1, 61) / 2
ROBOT = am.load("huynh_3r")
OFF = ROBOT.with_values({path: 1.4 * value for path, value in ROBOT.parameters().items()})
K = "links.arm.elasticity.z.stiffness"


def noisy(H: am.Frf, seed: int, noise: float = 0.02) -> am.Frf:
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *H.values.shape))
    return replace(H, values=H.values * (1 + noise * (real + 1j * imaginary)))


def measured(robot: am.Robot = ROBOT, posture: Any = "milling", seed: int = 0) -> am.Measurement:
    return am.Measurement(noisy(am.frf(robot, posture, FREQ_HZ, frame="sensor"), seed), posture)


def assert_same(fit: am.Fit, other: am.Fit) -> None:
    """Bit for bit, in everything that a run makes."""
    assert fit.parameters == other.parameters
    assert (fit.cost, fit.start_cost, fit.starts) == (other.cost, other.start_cost, other.starts)
    assert (fit.status, fit.message, fit.evaluations) == (other.status, other.message, other.evaluations)
    assert np.array_equal(fit.cost_history, other.cost_history)
    assert [(s.name, s.sigma) for s in fit.stages] == [(s.name, s.sigma) for s in other.stages]
    assert np.array_equal(fit.covariance, other.covariance)
    assert fit.robot.to_yaml() == other.robot.to_yaml()
    assert fit.record.fingerprint == other.record.fingerprint


GENETIC = am.Genetic(population=8, generations=4, rounds=2, simplex_iterations=30)
HELD = {p: v for p, v in ROBOT.parameters().items() if p != K}
TASKS: dict[str, Callable[..., am.Fit]] = {
    "one start": lambda **o: am.update(OFF, measured(), **o),
    "three starts": lambda **o: am.update(OFF, measured(), starts=3, seed=4, **o),
    "18 parameters, two starts": lambda **o: am.update(
        am.load(START), measured(am.load("kuka_kr90")), starts=2, **o
    ),
    "plain least squares from four": lambda **o: am.update(
        OFF, measured(), starts=4, method="least_squares", weights=None, **o
    ) if "weights" in o else am.update(OFF, measured(), starts=4, method="least_squares", **o),
    "robust, with priors": lambda **o: am.update(
        OFF, measured(), starts=2, loss="huber", priors={"*.damping": 0.3}, **o
    ),
    "modes": lambda **o: am.update(
        OFF,
        am.ModalMeasurement("milling", *modal()),
        priors={"*.damping": Prior(0.1)},
        starts=2,
        **o,
    ),
    "masses": lambda **o: am.update(
        ROBOT.with_values({"links.arm.mass": 200.0}), measured(), parameters=["links.arm.mass", "*.stiffness"], **o
    ),
    "a law, with starts where it has no answer": lambda **o: am.update(
        OFF,
        [measured(posture=q) for q in ("milling", [0.4, 0.9, -1.2])],
        laws={K: Law("arm.z")},
        starts=3,
        **o,
    ),
    "genetic": lambda **o: am.update(
        OFF, measured(), method="genetic", genetic=GENETIC, max_evaluations=400, seed=5, **o
    ),
    "genetic, robust": lambda **o: am.update(
        OFF, measured(), method="genetic", genetic=GENETIC, loss="cauchy", seed=6, **o
    ),
}  # fmt: skip


def modal() -> tuple[Any, Any]:
    found = am.modes(ROBOT, "milling")
    return found.natural_freq_hz, found.damping_ratio


def broken_off(run: Callable[..., am.Fit], file: Path, after: int) -> am.Fit | None:
    """Runs with a checkpoint until so many evaluations are done."""

    def progress(now: am.updating.Progress) -> None:
        if now.evaluations >= after:
            raise KeyboardInterrupt

    try:
        return run(checkpoint=file, progress=progress, threads=1)
    except KeyboardInterrupt:  # before there was anything to keep
        return None


@pytest.mark.parametrize("name", TASKS)
def test_a_run_that_is_broken_off_again_and_again_ends_as_if_it_had_not_been(name: str, tmp_path: Path) -> None:
    run, file = TASKS[name], tmp_path / "run.json"
    whole = run()
    breaks = 0
    for _ in range(60):
        # Later and later, so that every stage is broken off somewhere and one more is done each time.
        fit = broken_off(run, file, 4 + 9 * breaks)
        if fit is not None and fit.status != "interrupted":
            break
        breaks += 1
        assert fit is None or fit.message == "stopped by the user"
    assert breaks >= 1
    assert fit is not None
    assert_same(fit, whole)
    assert_same(run(checkpoint=file), whole)  # and once more from the end


@pytest.mark.parametrize("name", ["three starts", "genetic", "robust, with priors"])
def test_every_state_that_is_saved_leads_to_the_same_end(name: str, tmp_path: Path) -> None:
    run, states = TASKS[name], list[bytes]()
    file = tmp_path / "run.json"

    def progress(now: am.updating.Progress) -> None:
        if file.exists() and (not states or states[-1] != file.read_bytes()):
            states.append(file.read_bytes())

    whole = run(checkpoint=file, progress=progress, threads=1)
    assert len(states) >= 4
    assert_same(whole, run())
    for state in states:
        file.write_bytes(state)
        assert_same(run(checkpoint=file), whole)


@pytest.mark.parametrize(
    "name", ["three starts", "18 parameters, two starts", "a law, with starts where it has no answer"]
)
def test_threads_change_nothing(name: str) -> None:
    run = TASKS[name]
    in_turn = run(threads=1)
    for threads in (2, 5):
        assert_same(run(threads=threads), in_turn)


def test_threads_and_turns_share_a_checkpoint(tmp_path: Path) -> None:
    run, file = TASKS["three starts"], tmp_path / "run.json"
    broken_off(run, file, 25)
    assert file.exists()
    assert_same(run(checkpoint=file, threads=3), run())


OTHERS: dict[str, Callable[[Path], am.Fit]] = {
    "another robot": lambda file: am.update(OFF.with_values({K: 1.5e6}), measured(), checkpoint=file),
    "other data": lambda file: am.update(OFF, measured(seed=1), checkpoint=file),
    "other parameters": lambda file: am.update(OFF, measured(), parameters="stiffness", checkpoint=file),
    "other bounds": lambda file: am.update(OFF, measured(), bounds={K: (1e6, 1e7)}, checkpoint=file),
    "a tie": lambda file: am.update(OFF, measured(), ties=["*.stiffness"], checkpoint=file),
    "held": lambda file: am.update(OFF, measured(), hold=[K], checkpoint=file),
    "a prior": lambda file: am.update(OFF, measured(), priors={K: 0.1}, checkpoint=file),
    "a law": lambda file: am.update(OFF, measured(), laws={K: Law("arm.z")}, checkpoint=file),
    "another cost": lambda file: am.update(OFF, measured(), cost="relative", checkpoint=file),
    "another loss": lambda file: am.update(OFF, measured(), loss="huber", checkpoint=file),
    "another method": lambda file: am.update(OFF, measured(), method="least_squares", checkpoint=file),
    "genetic": lambda file: am.update(OFF, measured(), method="genetic", genetic=GENETIC, checkpoint=file),
    "another seed": lambda file: am.update(OFF, measured(), seed=1, checkpoint=file),
    "more starts": lambda file: am.update(OFF, measured(), starts=2, checkpoint=file),
    "another tolerance": lambda file: am.update(OFF, measured(), tolerance=1e-6, checkpoint=file),
    "other weights": lambda file: am.update(OFF, replace(measured(), weights="uniform"), checkpoint=file),
    "a band": lambda file: am.update(OFF, replace(measured(), band=(2, 20)), checkpoint=file),
    "a coherence": lambda file: am.update(OFF, replace(measured(), coherence=np.linspace(0.5, 1, 60)), checkpoint=file),
}


@pytest.mark.parametrize("other", OTHERS)
def test_a_checkpoint_of_another_problem_is_refused_and_left_alone(other: str, tmp_path: Path) -> None:
    file = tmp_path / "run.json"
    am.update(OFF, measured(), checkpoint=file)
    before = file.read_bytes()
    with pytest.raises(am.UpdateError, match="found a checkpoint of another problem") as caught:
        OTHERS[other](file)
    assert "\n" not in str(caught.value)
    assert file.read_bytes() == before


def test_what_does_not_change_the_result_does_not_spoil_a_checkpoint(tmp_path: Path) -> None:
    file = tmp_path / "run.json"
    whole = am.update(OFF, measured(), checkpoint=file)
    again = am.update(OFF, replace(measured(), label="tap test 7"), checkpoint=file, threads=2, progress=lambda _: None)
    assert again.parameters == whole.parameters


@pytest.mark.parametrize("method", ["continuation", "least_squares", "genetic"])
def test_an_interrupted_run_keeps_the_best_so_far(method: Any) -> None:
    seen: list[float] = []

    def progress(now: am.updating.Progress) -> None:
        seen.append(now.cost)
        if now.evaluations >= 20:
            raise KeyboardInterrupt

    genetic = GENETIC if method == "genetic" else None
    # Table 4's start of the KUKA takes around a hundred.
    fit = am.update(am.load(START), measured(am.load("kuka_kr90")), method=method, genetic=genetic, progress=progress)
    assert fit.status == "interrupted"
    assert fit.cost <= fit.start_cost
    assert len(fit.parameters) == 18
    assert fit.robot.parameters() != fit.start.parameters() or fit.cost == fit.start_cost
    assert len(seen) >= 2


def test_an_interrupt_between_starts_keeps_those_that_are_done_and_says_so() -> None:
    ended: list[int] = []

    def progress(now: am.updating.Progress) -> None:
        if now.done > 0.4:  # of four starts one is done, and half of the next
            ended.append(now.evaluations)
            raise KeyboardInterrupt

    fit = am.update(OFF, measured(), starts=4, threads=1, progress=progress)
    assert (fit.status, fit.message) == ("interrupted", "stopped by the user")
    assert len(ended) == 1
    assert 1 <= len(fit.starts) < 4
    assert fit.cost == pytest.approx(am.update(OFF, measured()).cost, rel=1e-9)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_of_one_start_ends_them_all(threads: int) -> None:
    def progress(now: am.updating.Progress) -> None:
        if now.evaluations > 30:
            raise KeyboardInterrupt

    kuka = measured(am.load("kuka_kr90"))
    fit = am.update(am.load(START), kuka, starts=6, threads=threads, progress=progress)
    assert fit.status == "interrupted"
    assert fit.evaluations < 60


def test_an_interrupt_ends_the_tries_that_follow_a_fit_that_explains_nothing() -> None:
    calls: list[int] = []

    def progress(now: am.updating.Progress) -> None:
        calls.append(now.evaluations)
        if len(calls) > 70:
            raise KeyboardInterrupt

    # Responses of another posture: no start explains them, and several more would be tried.
    data = replace(measured(posture=[0.4, 0.9, -1.2]), posture="milling")
    assert len(am.update(OFF, data).starts) > 1
    calls.clear()
    fit = am.update(OFF, data, progress=progress)
    assert fit.status == "interrupted"
    assert len(calls) <= 73
    assert np.isfinite(fit.cost)


@pytest.mark.parametrize("starts", [1, 3])
@pytest.mark.parametrize("error", [RuntimeError, am.ModelError])
def test_an_error_of_the_caller_comes_out_and_leaves_a_checkpoint_behind(
    error: Any, starts: int, tmp_path: Path
) -> None:
    file = tmp_path / "run.json"

    def progress(now: am.updating.Progress) -> None:
        if now.evaluations > 15:
            raise error("here", found="this", expected="that") if error is am.ModelError else error("mine")

    with pytest.raises(error):
        am.update(OFF, measured(), progress=progress, checkpoint=file, starts=starts)
    assert file.exists()
    assert_same(am.update(OFF, measured(), checkpoint=file, starts=starts), am.update(OFF, measured(), starts=starts))


def test_progress_counts_up_to_the_end() -> None:
    told: list[am.updating.Progress] = []
    fit = am.update(OFF, measured(), starts=2, threads=1, progress=told.append)
    done = [now.done for now in told]
    assert [now.evaluations for now in told] == sorted(now.evaluations for now in told)
    assert done == sorted(done)
    assert 0 <= done[0] < done[-1] <= 1
    assert told[-1].evaluations <= fit.evaluations <= told[-1].evaluations + 2
    assert all(now.left_s >= 0 for now in told)
