"""Whole jobs of a user, one a process: `python tests/benchmarks/jobs.py NAME` prints CPU seconds.

They use the public interface alone, so that an older version of the package runs them as well.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
import warnings
from collections.abc import Callable

warnings.simplefilter("ignore")


def _rows(n, **settings):
    import hybridsurrogate as hs
    from hybridsurrogate.datasets import make_log_sin

    case = make_log_sin(n_measured=n, random_state=0)
    model = hs.PowerScaledSurrogate(
        case.simulator, surrogate=hs.ExactSurrogate(), n_draws=1000, random_state=0
    )
    diagnosis = hs.DiscrepancyDiagnosis(model, random_state=0, **settings)
    return lambda: diagnosis.fit(case.X, case.y)


def _runs():
    import hybridsurrogate as hs
    from hybridsurrogate.datasets import make_log_sin

    case = make_log_sin(random_state=0)
    surrogate = hs.PolynomialChaos(degree=5)
    return case, hs.PowerScaledSurrogate(case.simulation, surrogate=surrogate, random_state=0)


def _case_1():
    import hybridsurrogate as hs

    case, model = _runs()
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    return lambda: diagnosis.fit(case.X, case.y)


def _scan():
    case, model = _runs()
    model.fit(case.X, case.y)
    return lambda: [model.set_params(beta=k / 20).fit(case.X, case.y) for k in range(21)]


def _grid_search():
    from sklearn.model_selection import GridSearchCV

    case, model = _runs()
    search = GridSearchCV(model, {"beta": [k / 20 for k in range(21)]}, cv=5)
    return lambda: search.fit(case.X, case.y)


def _report():
    import hybridsurrogate as hs

    case, model = _runs()
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(case.X, case.y)
    return lambda: diagnosis.report()._repr_html_()


def _curves(n_runs, n_times):
    import numpy as np
    from scipy.stats import uniform

    import hybridsurrogate as hs

    def level(t, k, c):
        return 3 * np.exp(-k * t) + c * (1 - np.exp(-0.3 * t))

    simulator = hs.Simulator(
        level, {"t": (0, 20)}, {"k": uniform(0.05, 0.25), "c": uniform(0.2, 0.6)}
    )
    runs = simulator.run(n_runs, along=n_times, random_state=0)
    random = np.random.RandomState(0)
    t = np.linspace(0, 20, 60)
    y = level(t, 0.15, 0.5) - 0.02 * t + 0.05 * random.standard_normal(60)
    model = hs.PowerScaledSurrogate(runs, random_state=0)
    diagnosis = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0)
    return lambda: diagnosis.fit(t[:, None], y)


def _import():
    return lambda: subprocess.run([sys.executable, "-c", "import hybridsurrogate"], check=True)


def _demo():
    command = [sys.executable, "-m", "hybridsurrogate", "demo"]
    return lambda: subprocess.run(command, check=True, capture_output=True)


JOBS: dict[str, Callable[[], Callable[[], object]]] = {
    "import": _import,
    "scan of 21 weights": _scan,
    "grid search, 21 weights in 5 folds": _grid_search,
    "100 runs, no folds": _case_1,
    "report": _report,
    "40 rows, no folds": lambda: _rows(40, cv=None),
    "40 rows, folds": lambda: _rows(40),
    "two causes, folds": lambda: _rows(40, max_causes=2, cv=5),
    "1,000 rows": lambda: _rows(1000, cv=None),
    "4,000 rows": lambda: _rows(4000, cv=None),
    "80 curves of 300": lambda: _curves(80, 300),
    "2,000 curves of 60": lambda: _curves(2000, 60),
    "demo": _demo,
}


def _cpu() -> float:
    of_others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + of_others.ru_utime + of_others.ru_stime


if __name__ == "__main__":
    run = JOBS[sys.argv[1]]()
    start = _cpu()
    run()
    used = _cpu() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"{used:.3f} {memory:.2f}")
