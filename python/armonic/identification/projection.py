"""Least squares over residues at given poles, of all responses at once, and how its misfit changes with the poles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from armonic.errors import FrfError
from armonic.response import KINDS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from armonic.frf_set import FrfSet

    Array: TypeAlias = NDArray[np.float64]
    Complex: TypeAlias = NDArray[np.complex128]
    Mask: TypeAlias = NDArray[np.bool_]

BLOCK = 4096
"""Lines whose products of columns are held at once."""
SAME = 1e-12
"""Relative weights this close to one over all lines are one."""
SINGULAR = 1e-14
"""A column that others make up but for this share of it is not determined."""


@dataclass(frozen=True, eq=False)
class Terms:
    """What a model has beside its poles: lower and upper residual; `real`: residues of real modes, φφᵀ / (2i Im λ)."""

    lower: bool = True
    upper: bool = True
    real: bool = False

    def count(self, poles: int) -> int:
        """Real unknowns of each response."""
        return poles * (1 if self.real else 2) + self.lower + self.upper


@dataclass(frozen=True, eq=False)
class Samples:
    """Values and weights of the K measured pairs, real parts of the L lines above their imaginary parts.

    Attributes:
        s: where the lines lie, (L,), rad/s.
        power: of s, from receptance to what was measured.
        values: times the line weights, (2L, K).
        line_weights: (2L,), common to all pairs.
        extra: squared weights beside them, (2L, K); None where they are all one.
        pair_weights: (K,), beside both.
        counts: real values of weight above zero, (K,).
    """

    s: Complex
    power: int
    values: Array
    line_weights: Array
    extra: Array | None
    pair_weights: Array
    counts: NDArray[np.intp]

    @classmethod
    def of(cls, frfs: FrfSet, terms: Terms, weights: ArrayLike | None = None) -> Samples:
        """Those of a set; a line at s = 0 that the model says nothing of is left out.

        Args:
            frfs: the responses.
            terms: of the model.
            weights: 1/σ of every value, (L, outputs, inputs) or what broadcasts to it; 0 leaves one out. One over the
                RMS of each response by default.

        Raises:
            FrfError: weights that do not fit, or no line left.
        """
        power = KINDS.index(frfs.kind)
        H = frfs.values[:, frfs.measured]
        if weights is None:
            rms = np.sqrt(np.mean(np.abs(H) ** 2, axis=0))
            W = np.broadcast_to(np.divide(1, rms, out=np.zeros_like(rms), where=rms > 0), H.shape)
        else:
            W = _checked(weights, frfs)[:, frfs.measured]
        used = W.any(axis=1) & ((frfs.s != 0) | (not terms.lower and power == 0))
        if not used.any():
            raise FrfError("weights", found="zero at every line", expected="one above zero at least")
        H, W, s = H[used], W[used], frfs.s[used]
        pair = np.sqrt(np.mean(W**2, axis=0))
        share = np.divide(W, pair, out=np.zeros_like(W), where=pair > 0)
        # Pairs without weight must not pull on the common one.
        line = np.sqrt(np.mean(share[:, pair > 0] ** 2, axis=1))
        extra = np.divide(share, line[:, None], out=np.zeros_like(share), where=line[:, None] > 0) ** 2
        plain = bool((np.abs(extra[:, pair > 0] - 1) < SAME).all())
        values = H * line[:, None]
        return cls(
            s=s,
            power=power,
            values=np.concatenate([values.real, values.imag]),
            line_weights=np.concatenate([line, line]),
            extra=None if plain else np.concatenate([extra, extra]),
            pair_weights=pair,
            counts=2 * np.count_nonzero(W, axis=0),
        )


def _checked(weights: ArrayLike, frfs: FrfSet) -> Array:
    expected = f"finite weights of zero or more, shape {frfs.values.shape}"
    try:
        W = np.broadcast_to(np.asarray(weights, np.float64), frfs.values.shape)
    except (TypeError, ValueError) as error:
        raise FrfError("weights", found=str(error), expected=expected) from None
    if not (np.isfinite(W[:, frfs.measured]).all() and (W[:, frfs.measured] >= 0).all()):
        raise FrfError("weights", found="a number that is none", expected=expected)
    return W


@dataclass(frozen=True, eq=False)
class Projected:
    """The best residues at given poles.

    Attributes:
        residues: complex, (n, K), of the receptance.
        lower: (K,), zero if not a term.
        upper: (K,).
        left: what is left of the values times the weights, (2L, K).
        costs: sum of squares of each pair's weighted misfit, (K,).
        tangent: change of that misfit with Re λ and Im λ of all poles, beside what residues make up for,
            (K, 2n, 2n); empty if not asked for.
        misfit: the misfit in the same coordinates, (K, 2n).
        strength: how the cost of each pair would grow without a pole's term, other residues made the best, (n, K).
        spanned: an orthonormal basis of all columns, (2L, N).
    """

    residues: Complex
    lower: Array
    upper: Array
    left: Array
    costs: Array
    tangent: Array
    misfit: Array
    strength: Array
    spanned: Array


def project(samples: Samples, poles: Complex, terms: Terms, *, tangent: bool = False) -> Projected:
    """Residues by least squares (LSFD), and the Jacobian of what they leave with respect to the poles.

    Terms and their derivatives with respect to the poles are columns common to all pairs; one orthogonal factorization
    serves them all, and where weights differ from pair to pair a small Cholesky factor of each on top of it. This is
    variable projection (Golub and Pereyra 1973) in the form of Kaufman 1975, who leaves out what vanishes with the
    misfit.

    Args:
        samples: values and weights.
        poles: λ, (n,), rad/s.
        terms: of the model.
        tangent: whether the Jacobian is wanted.

    Raises:
        FrfError: the lines do not determine the residues.
    """
    n, first = len(poles), terms.count(len(poles))
    columns = model_columns(samples, poles, terms, tangent=tangent)
    sizes = np.linalg.norm(columns, axis=0)
    _refuse_undetermined((samples.counts[samples.pair_weights > 0] >= first).all() and (sizes[:first] > 0).all())
    sizes = np.where(sizes > 0, sizes, 1.0)
    Q, T = np.linalg.qr(columns / sizes)
    _refuse_undetermined(T.shape[0] >= first and (np.abs(np.diagonal(T)[:first]) > SINGULAR).all())
    values, extra = samples.values, samples.extra
    if extra is None:
        R = np.broadcast_to(np.eye(len(T)), (values.shape[1], *T.shape[:1] * 2))
        seen = (Q.T @ values).T
        inner = np.linalg.solve(T[:first, :first], seen[:, :first].T).T
        left = values - Q[:, :first] @ (T[:first, :first] @ inner.T)
    else:
        R = _small_factors(Q, extra, samples.pair_weights > 0)
        seen = _solved(R, Q.T @ (extra * values))
        own = R[:, :first, :first]
        inner, left = np.zeros((values.shape[1], first)), values
        for _ in range(2):  # the second time mends what the squared weights cost in digits
            more = _solved(own, Q[:, :first].T @ (extra * left))
            inner = inner + np.linalg.solve(T[:first, :first], np.linalg.solve(own, more[:, :, None])[:, :, 0].T).T
            left = values - Q[:, :first] @ (T[:first, :first] @ inner.T)
    square = left**2 if extra is None else extra * left**2
    coefficients = (inner / sizes[:first]).T
    real, imag = (0.0, coefficients[:n]) if terms.real else (coefficients[:n], coefficients[n : 2 * n])
    residues = np.asarray(real + 1j * imag, np.complex128)
    at = terms.count(n) - terms.lower - terms.upper
    zero = np.zeros(values.shape[1])
    weights = samples.pair_weights
    free, misfit = np.zeros((len(zero), 0, 2 * n)), np.zeros((len(zero), 0))
    if tangent:
        free = np.matmul(R[:, first:, first:], T[first:, first:])
        free = np.matmul(free, sizes[first:, None] * _mixing(residues)) * weights[:, None, None]
        misfit = seen[:, first:] * weights[:, None]
    return Projected(
        residues=residues,
        lower=coefficients[at] if terms.lower else zero,
        upper=coefficients[-1] if terms.upper else zero,
        left=left,
        costs=square.sum(axis=0) * weights**2,
        tangent=free,
        misfit=misfit,
        strength=_strength(np.matmul(R[:, :first, :first], T[:first, :first]), inner, n, terms) * weights**2,
        spanned=Q,
    )


def _refuse_undetermined(determined: bool | np.bool_) -> None:
    if not determined:
        raise FrfError(
            "poles",
            found="residues that the lines do not determine",
            expected="more lines, or fewer poles",
            hint="Leave out poles close to each other, or the lower and upper residuals.",
        )


def model_columns(samples: Samples, poles: Complex, terms: Terms, *, tangent: bool = False) -> Array:
    """Terms of the model, and after them their derivatives, times the line weights: (2L, N).

    R/(s−λ) + conj R/(s−conj λ) has the columns of Re R and Im R; its derivatives are those of the squared quotients.
    """
    s = samples.s[:, None]
    near, far = 1 / (s - poles), 1 / (s - poles.conj())
    parts = [1j * (near - far)] if terms.real else [near + far, 1j * (near - far)]
    if terms.lower:
        parts.append(1 / s**2)
    if terms.upper:
        parts.append(np.ones_like(s))
    if tangent:
        parts += [near**2 + far**2, 1j * (near**2 - far**2)]
    E = np.concatenate(parts, axis=1) * (s**samples.power if samples.power else 1.0)
    return np.asarray(np.concatenate([E.real, E.imag]) * samples.line_weights[:, None])


def _mixing(residues: Complex) -> Array:
    """How the derivative columns combine for Re λ and Im λ, (K, 2n, 2n): R/(s−λ)² and iR/(s−λ)² of each pole."""
    n, pairs = residues.shape
    mixed = np.zeros((pairs, 2 * n, 2 * n))
    k = np.arange(n)
    mixed[:, k, k] = mixed[:, n + k, n + k] = residues.real.T
    mixed[:, n + k, k] = residues.imag.T
    mixed[:, k, n + k] = -residues.imag.T
    return mixed


def _small_factors(Q: Array, extra: Array, weighed: Mask) -> Array:
    """Upper triangles R with RᵀR = Qᵀ diag(extra) Q of every pair, (K, N, N).

    Raises:
        FrfError: values of weight zero leave too few.
    """
    N, lines = Q.shape[1], len(Q) // 2
    low = np.tril_indices(N)
    sums = np.zeros((extra.shape[1], len(low[0])))
    for start in range(0, lines, BLOCK):
        block = slice(start, min(start + BLOCK, lines))
        real, imag = Q[:lines][block], Q[lines:][block]
        sums += extra[:lines][block].T @ (real[:, low[0]] * real[:, low[1]] + imag[:, low[0]] * imag[:, low[1]])
    gram = np.zeros((extra.shape[1], N, N))
    gram[:, low[0], low[1]] = sums
    gram[:, low[1], low[0]] = sums
    gram[~weighed] = np.eye(N)
    try:
        return np.asarray(np.linalg.cholesky(gram).transpose(0, 2, 1))
    except np.linalg.LinAlgError:
        _refuse_undetermined(False)
        raise


def _solved(R: Array, right: Array) -> Array:
    """R⁻ᵀ of every column, (K, N)."""
    return np.asarray(np.linalg.solve(R.transpose(0, 2, 1), right.T[:, :, None])[:, :, 0])


def _strength(R: Array, inner: Array, n: int, terms: Terms) -> Array:
    """Growth of the cost, (n, K), as a pole's term is taken out: cᵀ C⁻¹ c with the covariance C of its coefficients."""
    inverse = np.linalg.inv(R)
    covariance = inverse @ inverse.transpose(0, 2, 1)
    k = np.arange(n)
    if terms.real:
        return np.asarray((inner[:, :n] ** 2 / covariance[:, k, k]).T)
    own = np.stack([k, n + k], axis=1)
    c = inner[:, own]
    C = covariance[:, own[:, :, None], own[:, None, :]]
    return np.asarray(np.einsum("kni,kni->nk", c, np.linalg.solve(C, c[:, :, :, None])[:, :, :, 0]))
