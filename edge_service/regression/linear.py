"""Linear regression that knows what it does not know.

Every estimator here is linear in the target, beta = A' y, so its error is sum_t a_j(t) e(t). The
variance of that sum is taken from the series a_j e itself, its autocorrelation included
(heteroskedasticity and autocorrelation consistent: Newey and West, 1987; truncation after Geyer,
1992): the residual of a machine is neither white nor equally strong everywhere.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from ..messages.samples import Booleans, Floats
from .interval_estimate import IntervalEstimate, around, undetermined

RANK_TOLERANCE = 1e-8
"""Singular values of the scaled regressors below this share of the greatest one count as zero."""
LEAST_SIGNAL = 3.0
"""A regressor whose root mean square is less than this many times its noise says nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearFit:
    """Coefficients of target = design @ coefficients, with what is known about them."""

    names: tuple[str, ...]  # of the regressors
    coefficients: Floats  # (p,); of smallest norm where the data leaves a choice
    covariance: Floats  # (p, p); infinite on the diagonal of what is undetermined
    residual: Floats  # target - design @ coefficients, (n,)
    residual_std: float  # with n - p degrees of freedom, in the unit of the target
    observations: Floats  # (p,), effective number behind each coefficient
    n_effective: float  # of the residual
    notes: dict[str, str]  # why a regressor is undetermined, by its name

    def interval_estimate(self, name: str, unit: str) -> IntervalEstimate:
        """One coefficient with its interval. Raises ValueError for an unknown name."""
        index = self.names.index(name)
        count = float(self.observations[index])
        if name in self.notes:
            return undetermined(unit, self.notes[name], count)
        sigma = math.sqrt(self.covariance[index, index])
        return around(float(self.coefficients[index]), sigma, unit, count, len(self.names))


def correlation_time(series: Floats) -> float:
    """Samples per independent one, 1 + 2 sum rho_k, of a series (n,); 1 for white noise.

    The sum ends where a pair of neighbouring autocorrelations is no longer positive (Geyer, 1992).
    """
    count = len(series)
    if count < 4:
        return 1.0
    centred = series - np.mean(series)
    spectrum = np.abs(fft.rfft(centred, fft.next_fast_len(2 * count))) ** 2
    covariance = fft.irfft(spectrum, fft.next_fast_len(2 * count))[:count]
    if covariance[0] <= 0.0:
        return 1.0
    rho = covariance / covariance[0]
    pairs = rho[: count // 2 * 2].reshape(-1, 2).sum(axis=1)
    ends = np.flatnonzero(pairs <= 0.0)
    total = float(np.sum(pairs[: ends[0]] if ends.size else pairs))
    return max(2.0 * total - 1.0, 1.0)


def effective_size(series: Floats) -> float:
    """Independent observations in a series (n,)."""
    return len(series) / correlation_time(series)


def least_squares(
    names: Sequence[str], design: Floats, target: Floats, noise_rms: Floats | None = None
) -> LinearFit:
    """Ordinary least squares by a rank-revealing singular value decomposition.

    Args:
        noise_rms: noise within each regressor, (p,), in its unit; one that is little more than
            its noise is left out as undetermined instead of being found to be nothing.

    Raises ValueError: there are fewer rows than regressors, or a number is not finite.
    """
    _require_rows(design, target)
    silent = _silent(design, noise_rms)
    scale = np.where(silent, np.inf, np.sqrt(np.sum(design**2, axis=0)))
    scale[scale == 0.0] = np.inf
    left, singular, right = np.linalg.svd(design / scale, full_matrices=False)
    kept = singular > RANK_TOLERANCE * singular[0] if singular[0] > 0.0 else singular > 0.0
    inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
    influence = (left * inverse) @ right / scale
    normal_inverse = (right.T * inverse**2) @ right / np.outer(scale, scale)
    notes = _null_notes(names, right[~kept], silent)
    return _fit_with_covariance(names, design, target, influence, normal_inverse, notes)


def instrumental_variables(
    names: Sequence[str], design: Floats, target: Floats, instruments: Floats
) -> LinearFit:
    """Instrumental variables: beta = (Z' X)^-1 Z' y.

    Consistent where regressors carry noise, or where a controller feeds the residual back into
    them, if the instruments follow the motion and know nothing of the noise: the same regressors
    from the commanded motion (Janot, Vandanjon and Gautier, 2014). Z is (n, p) as X is.

    Raises ValueError: like `least_squares`; shapes differ.
    """
    _require_rows(design, target)
    if instruments.shape != design.shape or not np.isfinite(instruments).all():
        raise ValueError(f"instruments: expected finite numbers of shape {design.shape}")
    columns = np.sqrt(np.sum(design**2, axis=0))
    rows = np.sqrt(np.sum(instruments**2, axis=0))
    columns, rows = (np.where(norm > 0.0, norm, np.inf) for norm in (columns, rows))
    cross = (instruments / rows).T @ (design / columns)
    left, singular, right = np.linalg.svd(cross)
    kept = singular > RANK_TOLERANCE * max(float(singular[0]), np.finfo(float).tiny)
    inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
    solve = (right.T * inverse) @ left.T
    influence = (instruments / rows) @ solve.T / columns
    normal_inverse = influence.T @ influence
    notes = _null_notes(names, right[~kept], np.zeros(len(names), dtype=bool))
    return _fit_with_covariance(names, design, target, influence, normal_inverse, notes)


def total_least_squares(
    names: Sequence[str], design: Floats, target: Floats, noise_rms: Floats, target_noise_rms: float
) -> LinearFit:
    """Total least squares with exact and noisy regressors mixed (Van Huffel and Vandewalle, 1991).

    The exact regressors are projected out; of the noisy ones and the target, each in units of its
    noise, the direction of least variance is the relation between them. It equals least squares
    with lambda^2 noise^2 taken off the diagonal of X' X, which gives the influence of each row.

    Args:
        noise_rms: (p,), noise within each regressor; 0 is exact. Noises are independent.
        target_noise_rms: greater than 0.

    Raises ValueError: like `least_squares`; the target has no noise; regressors are collinear,
    which least squares reports and this cannot.
    """
    _require_rows(design, target)
    if not target_noise_rms > 0.0:
        raise ValueError(f"target_noise_rms must be greater than 0, got {target_noise_rms:g}")
    noisy = noise_rms > 0.0
    if not noisy.any():
        return least_squares(names, design, target)
    exact = np.linalg.qr(design[:, ~noisy])[0]
    joined = np.column_stack((design[:, noisy] / noise_rms[noisy], target / target_noise_rms))
    least = np.linalg.svd(joined - exact @ (exact.T @ joined), compute_uv=False)[-1]
    corrected = design.T @ design - least**2 * np.diag(noise_rms**2)
    scale = np.sqrt(np.diag(design.T @ design))
    if not (scale > 0.0).all() or np.linalg.cond(corrected / np.outer(scale, scale)) > 1e12:
        raise ValueError("regressors are collinear; use least_squares, which says which")
    solve = np.linalg.inv(corrected / np.outer(scale, scale)) / np.outer(scale, scale)
    influence = design @ solve
    return _fit_with_covariance(names, design, target, influence, solve, {})


def _fit_with_covariance(
    names: Sequence[str],
    design: Floats,
    target: Floats,
    influence: Floats,
    normal_inverse: Floats,
    notes: dict[str, str],
) -> LinearFit:
    """Fit beta = influence' y with its residual and covariance; influence (n, p)."""
    coefficients = influence.T @ target
    residual = target - design @ coefficients
    count, parameters = design.shape
    scores = influence * residual[:, None]
    times = np.array([correlation_time(scores[:, j]) for j in range(parameters)])
    freedom = count / max(count - parameters, 1)
    variance = times * np.sum(scores**2, axis=0) * freedom
    root = np.sqrt(np.diag(normal_inverse))
    root[root == 0.0] = np.inf
    covariance = normal_inverse / np.outer(root, root) * np.sqrt(np.outer(variance, variance))
    for index, name in enumerate(names):
        if name in notes:
            covariance[index, index] = np.inf
    return LinearFit(
        names=tuple(names),
        coefficients=coefficients,
        covariance=covariance,
        residual=residual,
        residual_std=float(np.linalg.norm(residual)) / math.sqrt(max(count - parameters, 1)),
        observations=count / times,
        n_effective=effective_size(residual),
        notes=notes,
    )


def _require_rows(design: Floats, target: Floats) -> None:
    count, parameters = design.shape
    if target.shape != (count,):
        raise ValueError(f"target: expected shape ({count},), got {target.shape}")
    if count <= parameters:
        raise ValueError(f"{count} rows cannot determine {parameters} parameters; record more")
    if not (np.isfinite(design).all() and np.isfinite(target).all()):
        raise ValueError("regressors and target must be finite")


def _silent(design: Floats, noise_rms: Floats | None) -> Booleans:
    if noise_rms is None:
        return np.zeros(design.shape[1], dtype=bool)
    signal = np.sqrt(np.mean(design**2, axis=0))
    silent: Booleans = (noise_rms > 0.0) & (signal < LEAST_SIGNAL * noise_rms)
    return silent


def _null_notes(names: Sequence[str], null: Floats, silent: Booleans) -> dict[str, str]:
    """Notes on undetermined regressors; `null` (k, p) spans what the scaled data does not show."""
    notes = {}
    share = np.sum(null**2, axis=0) if len(null) else np.zeros(len(names))
    for index, name in enumerate(names):
        if silent[index]:
            notes[name] = f"{name} is only noise in this recording"
        elif share[index] > RANK_TOLERANCE:
            tied = np.abs(null[np.abs(null[:, index]) > RANK_TOLERANCE]).max(axis=0)
            others = [other for k, other in enumerate(names) if tied[k] > 1e-4 and k != index]
            rivals = ", ".join(others)
            notes[name] = (
                f"cannot be told from {rivals}" if others else f"no {name} in the recording"
            )
    return notes
