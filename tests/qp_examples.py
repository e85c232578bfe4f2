"""Random quadratic programs, and independent solvers for them."""

import daqp
import numpy as np
import quadprog

# Sizes (variables, equalities, inequalities); the last is a hard one from a
# cold start: some twenty of its inequalities are active.
SIZES = [(4, 0, 10), (4, 1, 10), (12, 3, 20), (41, 18, 80)]


def random_qp(seed, n, equalities, inequalities):
    """A feasible QP whose bounds are partly infinite."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n))
    inside = rng.normal(size=n)
    A_eq = rng.normal(size=(equalities, n))
    C = rng.normal(size=(inequalities, n))
    lower = C @ inside - rng.exponential(size=inequalities)
    upper = C @ inside + rng.exponential(size=inequalities)
    lower[rng.random(inequalities) < 0.3] = -np.inf
    upper[rng.random(inequalities) < 0.3] = np.inf
    H = root @ root.T + 0.01 * np.eye(n)
    return H, 5.0 * rng.normal(size=n), A_eq, A_eq @ inside, C, lower, upper


def by_quadprog(H, g, A_eq, b_eq, C, lower, upper):
    below, above = np.isfinite(lower), np.isfinite(upper)
    rows = np.vstack([A_eq, C[below], -C[above]])
    bounds = np.concatenate([b_eq, lower[below], -upper[above]])
    return quadprog.solve_qp(H, -g, rows.T, bounds, len(b_eq))[0]


def by_daqp(H, g, A_eq, b_eq, C, lower, upper):
    rows = np.ascontiguousarray(np.vstack([A_eq, C]))
    above = np.concatenate([b_eq, np.minimum(upper, 1e30)])
    below = np.concatenate([b_eq, np.maximum(lower, -1e30)])
    sense = np.zeros(len(above), dtype=np.int32)
    sense[: len(b_eq)] = 5  # equality
    x, _, flag, _ = daqp.solve(H, g, rows, above, below, sense)
    assert flag == 1
    return x
