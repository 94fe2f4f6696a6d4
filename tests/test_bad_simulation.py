"""What a simulation cannot do is refused in one line that says where, what was found and what to do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import armonic as am
from closed_loops import driven_hinge
from models import oscillator, pendulum, robot_of, slides, spring
from simulated import HIT, scompi


def message(error: pytest.ExceptionInfo[am.ArmonicError]) -> str:
    text = str(error.value)
    assert "\n" not in text
    assert ": found " in text
    assert ", expected " in text
    return text


RUNS = [
    ({"duration_s": 0.0}, "duration_s: found 0.0, expected a finite number above 0"),
    ({"duration_s": math.nan}, "duration_s: found nan"),
    ({"duration_s": -1.0}, "duration_s: found -1.0"),
    ({"duration_s": "1 s"}, "duration_s: found '1 s'"),
    ({"duration_s": None}, "duration_s: found None"),
    ({"duration_s": 1e-4}, "duration_s: found 0.0001 s at 1000 Hz, 1 samples, expected 2 to 20000000 samples"),
    ({"duration_s": 1e6}, "duration_s: found 1e+06 s at 1000 Hz, 1000000001 samples"),
    ({"sample_rate_hz": 0.0}, "sample_rate_hz: found 0.0"),
    ({"sample_rate_hz": math.inf}, "sample_rate_hz: found inf"),
    ({"frames": ["toll"]}, "toll"),
    ({"displacement": {"link_9.z": 0.1}}, "displacement: found 'link_9.z', expected a coordinate or motor that moves"),
    ({"displacement": {"link_2.z": math.nan}}, "displacement of link_2.z: found nan, expected a finite number"),
    ({"velocity": {"link_2.motor": math.inf}}, "velocity of link_2.motor: found inf"),
    ({"velocity": {"link_2.z": "fast"}}, "velocity of link_2.z: found 'fast'"),
    ({"excitations": 50.0}, "excitations: found 50.0, expected Impulse, HammerPulse"),
    ({"excitations": [HIT, "hit"]}, "excitations: found 'hit'"),
    ({"wrench": [1.0] * 6}, "frame: found nothing, expected the frame at which the wrench acts"),
    ({"wrench": [1.0] * 5, "frame": "tool"}, "wrench: found [1.0, 1.0, 1.0, 1.0, 1.0]"),
    ({"wrench": [math.nan] * 6, "frame": "tool"}, "wrench: found [nan"),
    ({"frame": "tool"}, "frame: found 'tool' without a wrench"),
    ({"equilibrium": "dynamic"}, 'equilibrium: found \'dynamic\', expected "reference" or "static"'),
    ({"posture": "c9"}, "c9"),
    ({"posture": [0.0] * 5}, "posture"),
]


@pytest.mark.parametrize(("options", "says"), RUNS, ids=[says[:40] for _, says in RUNS])
@pytest.mark.parametrize("run", [am.simulate, am.linear_response])
def test_odd_runs_are_refused(run: Any, options: dict[str, Any], says: str) -> None:
    asked = {"posture": "c8", "duration_s": 0.1} | options
    with pytest.raises((am.SimulationError, am.PostureError)) as error:
        run(scompi(), asked.pop("posture"), asked.pop("excitations", ()), **asked)
    if run is am.simulate or not says.startswith(("displacement", "velocity")):
        assert says in message(error)
    else:  # the linear response has its own words for what moves
        assert message(error).startswith(says.split(" ")[0].rstrip(":"))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"tolerance": 0.0}, "tolerance: found 0.0, expected a number from 1e-14 to 0.01"),
        ({"tolerance": 1.0}, "tolerance: found 1.0"),
        ({"tolerance": math.nan}, "tolerance: found nan"),
        ({"tolerance": "tight"}, "tolerance: found 'tight'"),
        ({"method": "euler"}, "method: found 'euler', expected one of auto, explicit, implicit"),
    ],
)
def test_odd_settings_of_the_steps_are_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(am.SimulationError) as error:
        am.simulate(scompi(), "c8", duration_s=0.1, **options)
    assert says in message(error)


AT = {"axis": "x", "frame": "tool"}
EXCITATIONS = [
    (lambda: am.Step(axis="w", force=1.0), "Step.axis: found 'w', expected x, y, z, rx, ry or rz of the frame"),
    (lambda: am.Step(axis=None, force=1.0), "Step.axis: found None"),
    (lambda: am.Step(force=math.nan, **AT), "Step.force: found nan, expected a finite number"),
    (
        lambda: am.Step(force=1.0, start_s=-0.1, **AT),
        "Step.start_s: found -0.1, expected a finite number of at least 0",
    ),
    (lambda: am.Impulse(force=1.0, duration_s=0.0, **AT), "Impulse.duration_s: found 0.0, expected .* above 0"),
    (lambda: am.HammerPulse(force=1.0, duration_s=-1.0, **AT), "HammerPulse.duration_s: found -1.0"),
    (lambda: am.Sine(force=1.0, freq_hz=math.inf, **AT), "Sine.freq_hz: found inf"),
    (lambda: am.Sine(force=1.0, freq_hz=1.0, start_s=2.0, stop_s=1.0, **AT), "Sine.stop_s: found 1.0, .* above 2"),
    (
        lambda: am.Sweep(force=1.0, from_hz=0.0, to_hz=9.0, logarithmic=True, **AT),
        "Sweep.from_hz: found 0.0, .* above 0",
    ),
    (lambda: am.Sweep(force=1.0, from_hz=1.0, to_hz=-9.0, **AT), "Sweep.to_hz: found -9.0, .* at least 0"),
    (lambda: am.BandNoise(rms=-1.0, low_hz=1.0, high_hz=9.0, **AT), "BandNoise.rms: found -1.0"),
    (lambda: am.BandNoise(rms=1.0, low_hz=9.0, high_hz=9.0, **AT), "BandNoise.high_hz: found 9.0, .* above 9"),
    (lambda: am.MeasuredForce(values=[1.0], sample_rate_hz=1e3, **AT), r"MeasuredForce.values: found shape \(1,\)"),
    (lambda: am.MeasuredForce(values=[1.0, math.nan], sample_rate_hz=1e3, **AT), "found nan at sample 1"),
    (lambda: am.MeasuredForce(values=["a", "b"], sample_rate_hz=1e3, **AT), "MeasuredForce.values: found could not"),
    (lambda: am.MeasuredForce(values=[1.0, 2.0], sample_rate_hz=0.0, **AT), "MeasuredForce.sample_rate_hz: found 0.0"),
]


@pytest.mark.parametrize(("make", "says"), EXCITATIONS)
def test_odd_excitations_are_refused_where_they_are_made(make: Any, says: str) -> None:
    with pytest.raises(am.SimulationError, match=says) as error:
        make()
    message(error)


@pytest.mark.parametrize("run", [am.simulate, am.linear_response])
def test_excitations_that_do_not_fit_the_robot_are_refused(run: Any) -> None:
    with pytest.raises(am.PostureError, match="spindle") as error:
        run(scompi(), "c8", am.Step(axis="x", frame="spindle", force=1.0), duration_s=0.1)
    message(error)
    with pytest.raises(am.SimulationError, match=r"Step\.frame: found none, expected one of base, mass_0"):
        run(oscillator(1.0, 1e4), [0.0], am.Step(axis="x", force=1.0), duration_s=0.1)
    narrow = am.BandNoise(axis="x", rms=1.0, low_hz=20.0, high_hz=20.5)
    with pytest.raises(am.SimulationError, match=r"BandNoise: found 20 to 20\.5 Hz for 0\.1 s, .* Widen the band"):
        run(scompi(), "c8", narrow, duration_s=0.1)
    shrill = am.BandNoise(axis="x", rms=1.0, low_hz=20.0, high_hz=1e9)
    with pytest.raises(am.SimulationError, match=r"BandNoise\.high_hz: found 1e\+09 Hz for 0\.1 s, .* at most 2"):
        run(scompi(), "c8", shrill, duration_s=0.1)


def test_an_unstable_loop_ends_the_run_and_says_what_left_when() -> None:
    # Files refuse negative gains; a state feedback may be of any sign, and this one makes 300 N m s/rad of kd to -300.
    feedback = {"position": [[0.0, 0.0]], "velocity": [[0.0, -600.0]]}
    robot = driven_hinge(inertia=1.0, control={"kp": 8000.0, "kd": 300.0, "state_feedback": feedback})
    slowest = am.modes(robot, [0.0]).poles.real.max()
    assert slowest > 0
    with pytest.raises(am.SimulationError) as error:
        am.simulate(robot, [0.0], displacement={"rod.y": 1e-3}, duration_s=60 / slowest)
    text = message(error)
    assert "rod.motor beyond all bounds at " in text or "rod.y beyond all bounds at " in text
    assert "The loop is unstable" in text
    run = error.value.run
    assert run is not None
    at = float(text.split(" at ")[1].split(" s")[0])
    assert 0 <= at - run.series.time_s[-1] < 0.05
    assert np.isfinite(run.series.values).all()
    # From 1e-3 rad to 1e3 rad it takes ln(1e6) of the growth's time, more or less by what the start holds of it.
    assert at == pytest.approx(math.log(1e6) / slowest, rel=0.3)


@pytest.mark.parametrize("method", ["explicit", "implicit"])
def test_a_softening_spring_that_gives_way_is_told(method: Any) -> None:
    with pytest.raises(
        am.SimulationError, match=r"mass_0\.tx beyond all bounds at |steps too short to go on at "
    ) as error:
        am.simulate(
            oscillator(1.0, 1e4),
            [0.0],
            joints=am.Hardening(joint="mass_0", cubic=-1e8),
            displacement={"mass_0.tx": 0.02},
            duration_s=1.0,
            method=method,
        )
    message(error)
    assert error.value.run is not None
    assert len(error.value.run.series) > 10


def test_a_robot_that_cannot_move_or_has_no_mass_is_refused() -> None:
    fixed = robot_of(
        [{"name": "arm", "parent": "base", "joint": {"type": "revolute", "axis": "z"}, "mass": 1.0}],
    )
    with pytest.raises(am.SimulationError, match="no coordinate that moves") as error:
        am.simulate(fixed, [0.0], duration_s=0.1)
    message(error)
    empty = slides([1.0, 0.0], [spring(1e4), spring(1e4)])
    with pytest.raises((am.SimulationError, am.ModelError), match="mass matrix that is not positive definite") as error:
        am.simulate(empty, [0.0, 0.0], duration_s=0.1)
    message(error)


def test_a_spring_too_soft_for_gravity_has_no_static_start() -> None:
    falls = pendulum(1.0, mass=3.0, length=0.5, gravity=[0, 0, -9.81])
    with pytest.raises(am.ModelError, match="no stable static equilibrium"):
        am.simulate(falls, [0.3], duration_s=0.1, equilibrium="static")
    hinge = driven_hinge(inertia=1.0, mass=20.0, com=0.4, control={"kp": 8000.0, "kd": 300.0})
    with pytest.raises(am.SimulationError, match="Hardening: found a spring too soft for the load"):
        am.simulate(hinge, [0.7], joints=am.Hardening(joint="rod", cubic=-1e12), duration_s=0.1)
