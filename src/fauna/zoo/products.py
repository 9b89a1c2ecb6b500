"""Matrix products whose rounding does not depend on the number of BLAS threads."""

import numpy as np
from jaxtyping import Float


def dot(rows: Float[np.ndarray, "..."], matrix: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """``rows @ matrix`` for many rows and a small matrix (k, j) or vector (k,), summed in a fixed order."""
    return np.einsum("...k,kj->...j" if matrix.ndim == 2 else "...k,k->...", rows, matrix, optimize=False)
