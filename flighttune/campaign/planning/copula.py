"""Rank correlation of dispersed keys by a Gaussian copula."""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from flighttune.arrays import FloatArray
from flighttune.campaign.planning.disperse_table import CorrelationTable
from flighttune.campaign.planning.distributions import LARGEST_POINT, SMALLEST_POINT
from flighttune.errors import InputError


def correlated(
    u: FloatArray, keys: Sequence[str], correlations: Sequence[CorrelationTable]
) -> FloatArray:
    r"""Independent uniform coordinates made dependent, each still uniform.

    Parameters
    ----------
    u : ndarray, shape (n, len(keys)), 1
        Inside the open unit interval.
    keys : sequence of str
        Names of the coordinates.
    correlations : sequence of CorrelationTable
        Of these keys.

    Returns
    -------
    ndarray, shape (n, len(keys)), 1
        Inside the open unit interval; a coordinate without correlation is as it was.

    Raises
    ------
    InputError
        If the correlations contradict each other.

    Notes
    -----
    Normal scores with the correlation ``2 sin(pi rho / 6)`` have the rank correlation ``rho``
    (Spearman's) [1]_.

    References
    ----------
    .. [1] W. H. Kruskal, "Ordinal measures of association", J. Am. Stat. Assoc. 53 (1958) 814-861.
    """
    named = sorted({key for table in correlations for key in table.keys})
    if not named:
        return u
    lower = factor(correlations)
    columns = [keys.index(key) for key in named]
    scores = [ndtri(u[:, column]) for column in columns]
    result = u.copy()
    for i, column in enumerate(columns):
        if not np.any(lower[i, :i]):
            continue
        mixed = np.zeros(len(u))
        for j in range(i + 1):  # element by element, so that a chunk has the bits of the whole
            mixed += lower[i, j] * scores[j]
        result[:, column] = np.clip(ndtr(mixed), SMALLEST_POINT, LARGEST_POINT)
    return result


def factor(correlations: Sequence[CorrelationTable]) -> FloatArray:
    """Lower Cholesky factor of the correlation of the normal scores, keys sorted by name.

    Raises
    ------
    InputError
        If the correlations contradict each other.
    """
    named = sorted({key for table in correlations for key in table.keys})
    matrix = np.eye(len(named))
    for table in correlations:
        i, j = (named.index(key) for key in table.keys)
        matrix[i, j] = matrix[j, i] = 2.0 * np.sin(np.pi * table.rank / 6.0)
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        raise InputError(
            "`rank` of the [[correlation]] tables must be possible together (a positive definite "
            f"matrix), got one of smallest eigenvalue {smallest:.3g}"
        ) from None
