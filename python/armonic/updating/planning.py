"""The next measurement: which candidates tell most about what a fit leaves open, and what is known after them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armonic.errors import UpdateError
from armonic.linear import linearize
from armonic.text import listing
from armonic.updating.candidates import Candidate, candidates, lines_of
from armonic.updating.design import CRITERIA, Criterion, choose, deviations, deviations_beside, value, values
from armonic.updating.doubts import NOISELESS, doubts
from armonic.updating.expected import REACH, PlannedParameter, expected, limits, of_data
from armonic.updating.information import Outlook, of_candidates, of_measurements
from armonic.updating.measurement import Measurement
from armonic.updating.parameters import choose as choose_parameters
from armonic.updating.priors import anchors_of
from armonic.updating.result import Fit

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.robot import Robot
    from armonic.updating.candidates import Postures
    from armonic.updating.parameters import Bounds, Parameter
    from armonic.updating.priors import Prior

    Array: TypeAlias = NDArray[np.float64]

NOISE = 0.01
"""Standard deviation of one real part of ln H where nothing is known about the noise."""
LINES_HZ = np.arange(1, 151) / 5
"""Lines where neither the candidates nor a measurement have any: up to 30 Hz, every 0.2 Hz (Huynh et al. 2021)."""


@dataclass(frozen=True)
class Ranked:
    """What one candidate would add by itself.

    Attributes:
        candidate: the measurement.
        gain: by how much it makes the criterion fall.
        narrowing: how many times narrower it makes the intervals, geometric mean over all parameters.
        identified: how many parameters are identified after it.
    """

    candidate: Candidate
    gain: float
    narrowing: float
    identified: int


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """The measurements to make next, and what they are expected to determine.

    Attributes:
        robot: the robot whose numbers were taken for the true ones.
        parameters: interval and verdict of every parameter, before and after each chosen measurement.
        chosen: the measurements to make, the most useful first.
        ranking: every candidate by itself, the most useful first.
        criterion: what was made least.
        noise: standard deviation of the real and of the imaginary part of ln H that is expected of the candidates.
        deviations: standard deviations of x before and after each chosen measurement, (1 + chosen, c), with the weak
            prior, so that they are finite.
        information: of everything known before, the weak prior apart, (c, c), in x.
        prior: information of the weak prior, (c,).
        notes: what is gained, what stays open and what was assumed, in full sentences.
    """

    robot: Robot
    parameters: tuple[PlannedParameter, ...]
    chosen: tuple[Candidate, ...]
    ranking: tuple[Ranked, ...]
    criterion: Criterion
    noise: float
    deviations: Array
    information: Array
    prior: Array
    notes: tuple[str, ...]

    @cached_property
    def log_widths(self) -> Array:
        """Σ ln(width of the 95 % interval in x) over the parameters, (1 + chosen,), with the weak prior."""
        return np.asarray(np.log(2 * REACH * self.deviations).sum(axis=1))

    def __repr__(self) -> str:
        """What to measure and what becomes of the verdicts, in one line."""
        sides = (Counter(p.verdicts[i] for p in self.parameters) for i in (0, -1))
        before, after = (", ".join(f"{n} {verdict}" for verdict, n in side.items()) for side in sides)
        return f"Plan({'; '.join(c.label for c in self.chosen)}: {before} -> {after})"


def plan_measurement(
    robot: Robot,
    fit: Fit | Measurement | Sequence[Measurement] | None,
    candidates: Postures | Candidate | Sequence[Candidate],
    *,
    count: int = 2,
    criterion: Criterion = "intervals",
    noise: float | None = None,
    freq_hz: ArrayLike | None = None,
    parameters: str | Iterable[str] | None = None,
    bounds: Bounds | None = None,
    priors: Mapping[str, Prior | float] | None = None,
) -> Plan:
    """Chooses the next measurements: those that are expected to narrow the intervals of the parameters most.

    Under relative noise of standard deviation σ in both parts of ln H, a measurement carries the information
    Re DᴴD/σ² about the coordinates x of the fit, with D = ∂ln H/∂x; of independent measurements it adds up, and its
    inverse is the covariance of x. Every value of a matrix counts, H_ab and H_ba too. Sets are grown greedily and
    exchanged until no swap improves them (Fedorov 1972); few combinations are all tried. So that the criterion is
    finite where the data say nothing, each parameter is taken to lie within its bounds (without any, within a factor of
    1000 either way), as its 95 % interval. Intervals and verdicts do not count that as knowledge.

    Args:
        robot: the robot; a fit's values are put in.
        fit: what has been measured: a fit, or measurements that the robot was fitted to. None: nothing yet.
        candidates: `Candidate`s, or postures as for `armonic.updating.candidates.candidates`, then with the sensor and
            axes that were measured.
        count: how many to choose, each at most once.
        criterion: what to make least: "intervals" the sum of the logarithms of all intervals, "D" the volume of the
            confidence ellipsoid, "A" the sum of all variances.
        noise: σ of what will be measured; by default that of the fit or of the measurements' residual, or 0.01.
        freq_hz: lines of candidates that have none of their own, (L,), Hz; by default those of the first measurement,
            or 0.2 to 30 Hz.
        parameters: paths, shell patterns or groups as for `update`; by default those of the fit, or "elasticity".
        bounds: (low, high) by path or pattern, as for `update`; not for the parameters of a fit, which have theirs.
        priors: what is known about parameters from elsewhere, by path or pattern as for `update`. Counts as knowledge.
            A fit's own are known to it.

    Raises:
        UpdateError: options that do not fit, or a candidate that the robot does not have or that has no response; it is
            named.
        SurveyError: a grid or sample that does not fit the robot.
        PostureError: a measurement does not fit the robot.
        ModelError: the model has no response where it was measured.
    """
    measured = _measured(fit)
    _checked(count, criterion, noise)
    outlook = _outlook(robot, fit, measured, parameters, bounds)
    options = _candidates(outlook.robot, candidates, measured)
    if count > len(options):
        raise UpdateError("count", found=f"{count} of {len(options)} candidates", expected="no more than there are")
    lines = lines_of("freq_hz", freq_hz) if freq_hz is not None else measured[0].frf.freq_hz if measured else LINES_HZ
    known, sigma, notes = _known(outlook, fit, measured, noise)
    chosen_priors = _priors(outlook, priors)
    known = known + np.diag(chosen_priors)
    weak = np.where(chosen_priors > 0, 0.0, _weak(outlook.parameters))
    added = of_candidates(outlook, options, lines) / sigma**2
    base = known + np.diag(weak)
    order = choose(base, added, count, criterion)
    totals = base + np.concatenate([np.zeros((1, *base.shape)), np.cumsum(added[list(order)], axis=0)])
    everything = np.append(totals, (base + added.sum(axis=0))[None], axis=0)
    spread = deviations(everything)
    plan = Plan(
        robot=outlook.robot,
        parameters=expected(outlook.parameters, outlook.values, of_data(spread, weak)),
        chosen=tuple(options[i] for i in order),
        ranking=_ranking(outlook, options, base, added, weak, criterion),
        criterion=criterion,
        noise=sigma,
        deviations=spread[:-1],
        information=known,
        prior=weak,
        notes=(),
    )
    from armonic.updating.advice import advice

    absent = _absent(outlook, plan.chosen, lines)
    return replace(plan, notes=(*advice(plan), *absent, *_at_bound(fit), *notes))


def _checked(count: object, criterion: object, noise: float | None) -> None:
    if not isinstance(count, int | np.integer) or isinstance(count, bool) or count < 1:
        raise UpdateError("count", found=f"{count!r:.60}", expected="a whole number of at least 1")
    if criterion not in CRITERIA:
        raise UpdateError("criterion", found=f"{criterion!r:.60}", expected=f"one of {', '.join(CRITERIA)}")
    if noise is not None and not 0 < noise < np.inf:
        raise UpdateError("noise", found=f"{noise}", expected="a positive share, such as 0.01")


def _measured(fit: Any) -> tuple[Measurement, ...]:
    if fit is None or isinstance(fit, Fit):
        # A fit to modal parameters alone has no measured responses; its information is all there is.
        return () if fit is None else fit.measurements
    listed = (fit,) if isinstance(fit, Measurement) else tuple(fit) if isinstance(fit, Iterable) else (fit,)
    if not listed or any(not isinstance(m, Measurement) for m in listed):
        found = "an empty list" if not listed else f"a {type(fit).__name__}"
        raise UpdateError("fit", found=found, expected="a Fit, measurements, or None if there are none")
    return listed


def _outlook(
    robot: Robot,
    fit: object,
    measured: Sequence[Measurement],
    patterns: str | Iterable[str] | None,
    bounds: Bounds | None,
) -> Outlook:
    """The robot with the numbers of a fit, and the coordinates to plan for."""
    if isinstance(fit, Fit):
        found = {p.path: p.value for p in fit.parameters}
        if patterns is None:
            if bounds is not None:
                raise UpdateError("bounds", found="some beside a fit", expected="those of the fit, or `parameters` too")
            return Outlook(robot, fit.coordinates, np.array([found[p.path] for p in fit.coordinates]))
        robot = Outlook(robot, fit.coordinates, np.array([found[p.path] for p in fit.coordinates])).robot
    names = linearize(robot, measured[0].posture if measured else np.zeros(len(robot.coordinates))).impedances
    chosen = choose_parameters(robot, names, "elasticity" if patterns is None else patterns, bounds)
    return Outlook(robot, chosen, np.array([p.start for p in chosen]))


def _candidates(robot: Robot, given: Any, measured: Sequence[Measurement]) -> tuple[Candidate, ...]:
    listed = (given,) if isinstance(given, Candidate) else given
    if isinstance(listed, Sequence) and any(isinstance(entry, Candidate) for entry in listed):
        strange = [entry for entry in listed if not isinstance(entry, Candidate)]
        if strange:
            raise UpdateError("candidates", found=f"{strange[0]!r:.60} among Candidates", expected="only Candidates")
        return tuple(listed)
    if not measured:
        return candidates(robot, given)
    sight = measured_sight(measured)
    return candidates(robot, given, **sight)


def measured_sight(measured: Sequence[Measurement]) -> dict[str, Any]:
    """Sensor, impact point and axes of measurements, for candidates like them; of several sensors the first."""
    frame, impact = measured[0].frame, measured[0].frf.input_frame
    alike = [m.frf for m in measured if (m.frame, m.frf.input_frame) == (frame, impact)]
    axes = {
        side: tuple(dict.fromkeys(axis for H in alike for axis in getattr(H, side))) for side in ("outputs", "inputs")
    }
    return {"frames": frame, "impacts": impact, **axes}


def _known(
    outlook: Outlook, fit: object, measured: Sequence[Measurement], noise: float | None
) -> tuple[Array, float, tuple[str, ...]]:
    """Information of what was measured, the noise to expect, and what to say about both."""
    assumed = f"The noise is assumed: {_percent(NOISE)}."
    if fit is None:
        none = np.zeros((len(outlook.parameters),) * 2)
        return none, NOISE if noise is None else noise, () if noise is not None else (assumed,)
    own = isinstance(fit, Fit) and outlook.parameters == fit.coordinates
    if isinstance(fit, Fit) and own and not measured:  # to modes alone: its noise is not that of responses
        told = fit.doubts if noise is not None else (*fit.doubts, assumed)
        return fit.information, NOISE if noise is None else noise, told
    if isinstance(fit, Fit) and own and fit.noise >= NOISELESS:
        return fit.information, fit.noise if noise is None else noise, fit.doubts
    if isinstance(fit, Fit) and fit.modal_measurements:
        raise UpdateError("parameters", found="others than those of a fit to modes", expected="those of the fit")
    unscaled, seen, models = of_measurements(outlook, measured)
    if isinstance(fit, Fit):
        seen, told = fit.noise, fit.doubts
    else:
        frfs = [replace(m.frf, values=H) for m, H in zip(measured, models, strict=True)]
        told, _ = doubts(measured, frfs, [m.line_weights() for m in measured], seen)
    if seen >= NOISELESS:
        return unscaled / seen**2, seen if noise is None else noise, told
    sigma = NOISE if noise is None else noise
    sentence = f"The measured responses have no noise of their own; {_percent(sigma)} is taken for them as well."
    return unscaled / sigma**2, sigma, (*told, sentence)


def _absent(outlook: Outlook, chosen: Sequence[Candidate], lines: Array) -> tuple[str, ...]:
    """Responses of the chosen candidates that the model does not have, which a fit would refuse."""
    told = []
    for option in chosen:
        freq_hz = lines if option.freq_hz is None else np.asarray(option.freq_hz)
        place = outlook.at(option.posture)
        sight = (option.frame, option.outputs, option.inputs, option.input_frame or option.frame)
        _, _, present = outlook.seen(place, freq_hz[[0, freq_hz.size // 2, -1]], *sight)
        names = [f"H_{option.outputs[a]}{option.inputs[b]}" for a, b in np.argwhere(~present.any(axis=0))]
        if names:
            told.append(f"In {option.label} the model has no {listing(names)}: leave that out of the fit.")
    return tuple(told)


def _at_bound(fit: object) -> tuple[str, ...]:
    """What a fit found at a bound, where a plan about its value is one about the bound."""
    found = [p.path for p in fit.parameters if p.verdict == "at bound"] if isinstance(fit, Fit) else []
    if not found:
        return ()
    stands, it = ("stands", "it") if len(found) == 1 else ("stand", "them")
    return (f"{listing(found)} {stands} at a bound of the fit; what is said of {it} holds for that value.",)


def _percent(share: float) -> str:
    return f"{100 * share:.3g} % of every value (standard deviation of the real and of the imaginary part of ln H)"


def _weak(parameters: Sequence[Parameter]) -> Array:
    """Information of the weak prior, (c,): the bounds are a 95 % interval."""
    reach = [abs(p.coordinate(p.upper) - p.coordinate(p.lower)) / 2 for p in parameters]
    return np.array([(REACH / r) ** 2 for r in reach])


def _priors(outlook: Outlook, priors: Mapping[str, Prior | float] | None) -> Array:
    """Information of what is known from elsewhere, (c,)."""
    found = np.zeros(len(outlook.parameters))
    anchors = anchors_of(outlook.robot, outlook.parameters, priors or {})
    found[list(anchors.indices)] = np.array(anchors.deviations) ** -2.0
    return found


def _ranking(
    outlook: Outlook, options: Sequence[Candidate], base: Array, added: Array, weak: Array, criterion: Criterion
) -> tuple[Ranked, ...]:
    """Every candidate by itself, the most useful first."""
    before = float(value(base, criterion))
    gains = before - values(base, added, criterion)
    start, spread = deviations(base), deviations_beside(base, added)
    narrowing = np.exp(np.log(start / spread).mean(axis=1))
    identified = (of_data(spread, weak) <= limits(outlook.parameters, outlook.values)[0]).sum(axis=1)
    return tuple(
        Ranked(options[i], float(gains[i]), float(narrowing[i]), int(identified[i]))
        for i in np.argsort(-gains, kind="stable").tolist()
    )
