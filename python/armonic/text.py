"""Numbers and results in words: how tables, pictures, report and command line print what was computed."""

from __future__ import annotations

import math
from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armonic.response import Kind
    from armonic.updating import Fit
    from armonic.updating.uncertainty import Verdict

VERDICTS: tuple[Verdict, ...] = ("identified", "weak", "not identifiable", "at bound")
"""What a fit can say about a parameter, from best to worst."""

_KIND_POWER = {"receptance": "", "mobility": "/s", "accelerance": "/s²"}


def format_si(value: float, unit: str = "", *, digits: int = 4) -> str:
    """A value to so many significant digits; beyond 0.001 to 9999 its exponent is a multiple of three.

    Args:
        value: in SI; infinity prints as ∞ and NaN as n/a.
        unit: appended after a space.
        digits: significant digits, at least one.

    """
    return f"{_figures(float(value), digits)} {unit}".rstrip()


def _figures(value: float, digits: int) -> str:
    if math.isnan(value):
        return "n/a"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    if value == 0:
        return "0"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    exponent = int(power)
    if -3 <= exponent < 4:
        return f"{float(f'{mantissa}e{power}'):.{max(digits - 1 - exponent, 0)}f}"
    third = 3 * (exponent // 3)
    return f"{float(mantissa) * 10 ** (exponent - third):.{max(digits - 1 - exponent + third, 0)}f}e{third}"


def format_interval(low: float, high: float, *, signed: bool = False) -> str:
    """An interval as "lo … hi" to 4 significant digits; "open" stands where the data give no end.

    Args:
        low: lower end; minus infinity or NaN is open, and of a positive quantity zero too.
        high: upper end; infinity or NaN is open.
        signed: whether the quantity may be zero or negative.

    """
    left = format_si(low) if math.isfinite(low) and (signed or low > 0) else "open"
    right = format_si(high) if math.isfinite(high) else "open"
    return "open" if left == right == "open" else f"{left} … {right}"


def format_spread(low: float, high: float) -> str:
    """Half the width of a log-symmetric interval: "± 1.2 %", from a factor of two on "×/÷ 2.3", or "open"."""
    if not (low > 0 and math.isfinite(high) and high >= low):
        return "open"
    factor = math.exp(0.5 * (math.log(high) - math.log(low)))
    return f"± {format_percent(factor - 1, digits=2)}" if factor < 2 else f"×/÷ {format_si(factor, digits=2)}"


def format_percent(fraction: float, *, digits: int = 3) -> str:
    """A fraction in percent: 0.01081 is "1.08 %"."""
    return format_si(100 * fraction, "%", digits=digits)


def format_hz(frequency: float) -> str:
    """A frequency in Hz without its unit: two decimals, below 1 Hz four significant digits."""
    return f"{frequency:.2f}" if abs(frequency) >= 1 and math.isfinite(frequency) else format_si(frequency)


def format_duration(seconds: float) -> str:
    """A duration as one reads it: "38 ms", "1.24 s", "3 min 20 s", "2 h 05 min"."""
    if not seconds >= 0.001:
        return "under 1 ms"
    if seconds < 0.9995:
        return f"{1000 * seconds:.3g} ms"
    if seconds < 59.95:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def count(number: int, noun: str) -> str:
    """A number with its noun: "1 parameter", "18 parameters"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def listing(parts: list[str]) -> str:
    """Words in a row: "a, b and c"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""


def split_path(path: str) -> tuple[str, str]:
    """A parameter path as a short name and a quantity: ("arm.z", "stiffness").

    A path other than "links.<link>.elasticity.<axis>.<quantity>" or "bushings.<name>.<quantity>.<axis>" comes
    back whole, with an empty quantity.
    """
    head, _, rest = path.partition(".")
    if head == "links" and len(parts := rest.rsplit(".", 3)) == 4 and parts[1] == "elasticity":
        return f"{parts[0]}.{parts[2]}", parts[3]
    if head == "bushings" and len(parts := rest.rsplit(".", 2)) == 3:
        return f"{parts[0]}.{parts[2]}", parts[1]
    return path, ""


def parameter_name(path: str) -> str:
    """A parameter's name in a sentence: "arm.z stiffness", "arm.mass"."""
    own, per, variable = path.partition(" per ")  # the slope of a law
    name, quantity = split_path(own)
    return f"{f'{name} {quantity}' if quantity else own.removeprefix('links.')}{per}{variable}"


def frf_unit(kind: Kind, output: str, force: str) -> str:
    """The unit of one entry of an FRF: "(m/s²)/N" for the accelerance of an axis under a force.

    Args:
        kind: what is divided by the force.
        output: the response axis; one that starts with r is a rotation.
        force: the input axis; one that starts with r is a moment.

    """
    response = f"{'rad' if output.startswith('r') else 'm'}{_KIND_POWER[kind]}"
    return f"{f'({response})' if '/' in response else response}/{'(N·m)' if force.startswith('r') else 'N'}"


def noise_words(fit: Fit) -> str:
    """How far model and data are apart, and what the intervals make of it, in one sentence."""
    if fit.measurements:
        return (
            f"Model and measurement differ by about {format_percent(fit.noise, digits=2)} (one standard deviation, "
            "equal weights); the intervals take that for noise that is the same share of every value."
        )
    times = format_si(fit.noise, digits=2)
    return f"Modelled and measured modes differ by about {times} times the deviations that were stated."


def verdict_counts(fit: Fit) -> dict[Verdict, int]:
    """How many parameters have each verdict, all four in order, zeros included."""
    found = Counter(parameter.verdict for parameter in fit.parameters)
    return {verdict: found[verdict] for verdict in VERDICTS}


def summary(fit: Fit) -> str:
    """A fit in one paragraph: how it ended, what it reached at what expense, and what the data determine."""
    ended = {
        "converged": "The fit converged.",
        "limit": "The fit stopped at its limit of evaluations before it converged; more may improve it.",
        "interrupted": "The fit was interrupted; this is the best it had found by then.",
    }[fit.status]
    effort = f"{count(fit.evaluations, 'evaluation')} and {format_duration(fit.duration_s)}"
    if fit.cost == fit.start_cost:
        change = f"stayed at {format_si(fit.cost)}"
    else:
        way = "fell" if fit.cost < fit.start_cost else "rose"
        change = f"{way} from {format_si(fit.start_cost)} to {format_si(fit.cost)}"
    return f"{ended} The cost {change} in {effort}. {_determined(fit)}"


def _determined(fit: Fit) -> str:
    counts, total = verdict_counts(fit), len(fit.parameters)
    if counts["identified"] == total:
        return f"The data determine {'the one parameter' if total == 1 else f'all {total} parameters'}."
    words: dict[Verdict, str] = {
        "identified": "identified",
        "weak": "weakly determined",
        "not identifiable": "not identifiable from these data",
        "at bound": "at a bound",
    }
    verbs = {1: "is"}
    parts = [f"{n} {verbs.get(n, 'are')} {words[verdict]}" for verdict, n in counts.items() if n]
    return f"Of {count(total, 'parameter')}, {listing(parts)}."


def scatter(value: float, of: float, unit: str = "", *, digits: int = 2) -> str:
    """A standard deviation of a number; one of less than a millionth of it, which nobody should rely on, as a bound."""
    least = 1e-6 * abs(of)
    return format_si(value, unit, digits=digits) if value >= least else f"<{format_si(least, unit, digits=1)}"
