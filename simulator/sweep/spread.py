"""How a number is spread: the distributions that a sample is drawn from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_TAIL = 1e-3  # probability beyond each of the two ends that stand for a distribution


@dataclass(frozen=True)
class Spread:
    """A distribution of one number.

    Attributes
    ----------
    distribution : str
        "normal", "lognormal" or "triangular".
    centre : float
        Its mean before it is truncated; of a triangular one the mode.
    deviation : float
        Its standard deviation before it is truncated; of no meaning for a triangular one.
    low, high : float
        Where it is truncated; of a triangular one its ends.
    """

    distribution: str
    centre: float
    deviation: float = 0.0
    low: float = -math.inf
    high: float = math.inf

    def at(self, share: FloatArray | float) -> FloatArray:
        """The values below which some shares of all lie, from 0 to 1; the same shape."""
        law = self._law()
        below, above = float(law.cdf(self.low)), float(law.cdf(self.high))
        return np.asarray(law.ppf(below + np.asarray(share) * (above - below)))

    @property
    def ends(self) -> tuple[float, float]:
        """Two values between which nearly all others lie."""
        low, high = self.at(np.array([_TAIL, 1.0 - _TAIL])).tolist()
        return low, high

    def _law(self) -> Any:
        from scipy import stats

        if self.distribution == "normal":
            return stats.norm(self.centre, self.deviation)
        if self.distribution == "lognormal":
            width = math.sqrt(math.log1p((self.deviation / self.centre) ** 2))
            return stats.lognorm(width, scale=self.centre * math.exp(-0.5 * width**2))
        span = self.high - self.low
        return stats.triang((self.centre - self.low) / span, loc=self.low, scale=span)


def correlated(unit: FloatArray, correlation: FloatArray) -> FloatArray:
    """Independent shares as shares that are correlated, (n, n_axes): a Gaussian copula.

    Parameters
    ----------
    unit : (n, n_axes) array
        From 0 to 1.
    correlation : (n_axes, n_axes) array
        Of the normal variables behind the shares: of normal numbers their own.
    """
    from scipy.stats import norm

    least = np.finfo(np.float64).tiny
    normal = norm.ppf(np.clip(unit, least, 1.0 - np.finfo(np.float64).epsneg))
    return np.asarray(norm.cdf(normal @ np.linalg.cholesky(correlation).T))
