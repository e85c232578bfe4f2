"""Random quadratic programs, and independent solvers for them."""

import numpy as np
import quadprog
from pydrake.solvers import ClarabelSolver, MathematicalProgram, SolverOptions
from scipy.linalg import block_diag

from nadia_balance.core.math.qp import QpProblem

# Variables, equalities, inequalities; of the last, some twenty are active.
SIZES = [(4, 0, 10), (4, 1, 10), (12, 3, 20), (41, 18, 80)]


def random_qp(seed, n, equalities, inequalities) -> QpProblem:
    """A feasible QP whose bounds are partly infinite; equalities come first."""
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
    b = A_eq @ inside
    return QpProblem(
        H,
        5.0 * rng.normal(size=n),
        np.vstack((A_eq, C)),
        np.concatenate((b, lower)),
        np.concatenate((b, upper)),
    )


def by_quadprog(problem: QpProblem):
    """x (n,) of a dual active-set code; ValueError: there is no solution."""
    H, g, A, lower, upper = problem
    equal = lower == upper
    below, above = ~equal & np.isfinite(lower), ~equal & np.isfinite(upper)
    rows = np.vstack((A[equal], A[below], -A[above]))
    bounds = np.concatenate((lower[equal], lower[below], -upper[above]))
    return quadprog.solve_qp(H, -g, rows.T, bounds, int(equal.sum()))[0]


def with_slack(problem: QpProblem, cost: dict[int, float]) -> QpProblem:
    """The program whose rows, by number, may be violated at a `cost` s^2."""
    H, g, A, lower, upper = problem
    H = block_diag(H, np.diag(list(cost.values())))
    A = np.hstack((A, np.eye(len(A))[:, list(cost)]))
    return QpProblem(H, np.append(g, np.zeros(len(cost))), A, lower, upper)


def by_clarabel(problem: QpProblem):
    """x (n,) of an interior-point code, to about 1e-6; None: no solution."""
    H, g, A, lower, upper = problem
    program = MathematicalProgram()
    x = program.NewContinuousVariables(len(g))
    program.AddQuadraticCost(H, g, x, is_convex=True)
    program.AddLinearConstraint(A, lower, upper, x)
    result = ClarabelSolver().Solve(program, None, tight())
    return result.get_x_val() if result.is_success() else None


def tight() -> SolverOptions:
    """Clarabel's tolerances, a thousandth of its defaults."""
    options = SolverOptions()
    for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
        options.SetOption(ClarabelSolver.id(), name, 1e-11)
    return options
