"""Blind cases of an unseen store that exchanges with a state of an ODE, of other faults, of none.

The store is next to the equation, or in series: a term of the equation acts on it.

The truth is solved by scipy, apart from the package. The size of a fault is the root mean square of
what is left of it after the simulation's parameters have been fitted to the noise-free truth, in
standard deviations of the noise. The diagnosis is passed the simulation and the measurements only.

    python examples/studies/hidden_store.py --cases 20 --first 870000
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.stats import lognorm

import hybridsurrogate as hs

SIZE, ROWS, SPAN = 2.0, 40, 24.0
# what is hidden by whom the slopes are passed through, in turn
OTHERS = ("constant", "threshold", "crowding", "drift", "delay", "seasonal")
# what acts on a store in series instead of the observed state
TERMS: dict[str, Callable] = {
    "box": lambda t, x, loss, heat: loss * (outside(t)[0] - x),
    "dose": lambda t, x, elimination: -elimination * x,
    "growth": lambda t, x, rate, capacity: -rate * x**2 / capacity,
    "reaction": lambda t, x, first, second: -second * x,
}
# the order of the seeds
KINDS = ("store", "none", "others", "series")
# the share of the range of the output that noise may be
_NOISE = (0.003, 0.3)


def outside(t):
    """Return the temperature around a box, and whether its heater is on."""
    return 10 + 5 * np.sin(2 * np.pi * (t - 9) / 24), 1.0 * ((t % 9) > 5)


def box(t, state, loss, heat):
    around, on = outside(t)
    return loss * (around - state) + heat * on


def dose(t, state, elimination):
    return -elimination * state


def growth(t, state, rate, capacity):
    return rate * state * (1 - state / capacity)


def reaction(t, state, first, second):
    a, b = state
    return np.stack([-first * a, first * a - second * b])


# right-hand side, states, what is observed, initial state, medians of the parameters
SIMULATIONS: dict[str, tuple[Callable, tuple[str, ...], int, Callable, dict[str, float]]] = {
    "box": (box, ("air",), 0, lambda **p: [20.0], {"loss": 0.15, "heat": 4.0}),
    "dose": (dose, ("blood",), 0, lambda start, **_: [start], {"elimination": 0.15, "start": 8.0}),
    "growth": (growth, ("n",), 0, lambda **p: [0.5], {"rate": 0.4, "capacity": 10.0}),
    "reaction": (reaction, ("a", "b"), 1, lambda **p: [10.0, 0.0], {"first": 0.3, "second": 0.1}),
}


def simulator(name: str) -> hs.OdeSimulator:
    rhs, states, seen, start, medians = SIMULATIONS[name]
    called = {"dose": lambda start: [start]}.get(name, start(**medians))
    return hs.OdeSimulator(
        rhs,
        initial_state=called,
        observe=lambda state: state[seen],
        inputs={"hour": (0, SPAN)},
        parameters={key: lognorm(0.3, scale=value) for key, value in medians.items()},
        states=states,
        max_step=SPAN / 100,
    )


def solved(name: str, t, values: dict[str, float], fault: dict[str, float | str]):
    """Return the output at times t with a fault in the slope of the observed state."""
    rhs, states, seen, start, _ = SIMULATIONS[name]
    first = np.array(start(**values), dtype=float)
    rates = {k: v for k, v in values.items() if k != "start"}
    kind, n = fault.get("kind"), len(states)
    grid, path = [0.0], [first[seen]]

    def slopes(time, state):
        now, own = state[:n], dict(rates)
        if kind == "drift":
            changed = 1 + fault["amount"] * (time > fault["place"])
            own[next(iter(rates))] *= changed
        if kind == "delay":
            late = time - fault["lag"]
            now = now.copy()
            now[seen] = np.interp(late, grid, path)
        out = np.array(rhs(time, now, **own), dtype=float)
        x = state[seen]
        if kind == "constant":
            out[seen] += fault["rate"]
        elif kind == "threshold":
            out[seen] += fault["rate"] * max(x - fault["level"], 0)
        elif kind == "crowding":
            out[seen] += fault["rate"] * x * abs(x)
        elif kind == "seasonal":
            out[seen] += fault["rate"] * np.sin(2 * np.pi * time / fault["period"] + fault["phase"])
        elif kind in ("store", "series"):
            flow, moved = fault["exchange"] * (x - state[n]), 0.0
            out[seen] -= flow
            if kind == "series":
                out[seen] -= TERMS[name](time, x, **own)
                moved = TERMS[name](time, state[n], **own)
            out = np.append(out, (flow + moved) / fault["ratio"])
        return out

    if kind in ("store", "series"):
        first = np.append(first, fault["share"] * first[seen])
    if kind != "delay":
        found = solve_ivp(slopes, (0, SPAN), first, t_eval=t, rtol=1e-8, atol=1e-9, max_step=0.1)
        return found.y[seen] if found.success else np.full(len(t), np.inf)
    step, state = 0.01, first
    for time in np.arange(0, SPAN, step):
        middle = state + step / 2 * slopes(time, state)
        state = state + step * slopes(time + step / 2, middle)
        grid.append(time + step)
        path.append(state[seen])
    return np.interp(t, grid, path)


def drawn(kind: str, scale: float, rng) -> dict[str, float | str]:
    """Return a fault of a natural magnitude, scale being a typical size of the state."""
    sign = rng.choice([-1.0, 1.0])
    return {"kind": kind} | {
        "none": lambda: {},
        "store" if kind == "store" else "series": lambda: {
            "ratio": float(np.exp(rng.uniform(np.log(0.3), np.log(5)))),
            "exchange": float(np.exp(rng.uniform(np.log(0.1), np.log(2)))),
            "share": float(rng.choice([0.0, 1.0, rng.uniform(0.3, 1.5)])),
        },
        "constant": lambda: {"rate": sign * scale * rng.uniform(0.02, 0.1)},
        "threshold": lambda: {
            "rate": -rng.uniform(0.1, 0.5),
            "level": scale * rng.uniform(0.5, 1.2),
        },
        "crowding": lambda: {"rate": -rng.uniform(0.05, 0.3) / scale},
        "drift": lambda: {"amount": rng.choice([-0.5, 0.8]), "place": SPAN * rng.uniform(0.2, 0.7)},
        "delay": lambda: {"lag": rng.uniform(1, 4)},
        "seasonal": lambda: {
            "rate": scale * rng.uniform(0.03, 0.15),
            "period": rng.uniform(3, 12),
            "phase": rng.uniform(0, 6),
        },
    }[kind]()


def case(kind: str, seed: int):
    """Return the simulation's name, times, measurements and the fault."""
    rng = np.random.default_rng(seed)
    while True:
        name = list(SIMULATIONS)[rng.integers(len(SIMULATIONS))]
        _, _, _, _, medians = SIMULATIONS[name]
        values = {k: v * float(np.exp(0.2 * rng.standard_normal())) for k, v in medians.items()}
        t = np.sort(SPAN * (np.arange(ROWS) + rng.uniform(size=ROWS)) / ROWS)
        plain = solved(name, t, values, {})
        fault = drawn(kind, float(np.sqrt(np.mean(plain**2))), rng)
        truth = solved(name, t, values, fault)
        reach = float(np.ptp(truth))
        if kind == "none":
            return name, t, truth + rng.uniform(0.01, 0.1) * reach * rng.normal(size=ROWS), fault
        if not np.isfinite([plain, truth]).all():
            continue

        def missed(log_values, name=name, t=t, truth=truth, keys=tuple(values)):
            own = dict(zip(keys, np.exp(log_values).tolist(), strict=True))
            return np.minimum(solved(name, t, own, {}) - truth, 1e6)

        fit = least_squares(missed, np.log(list(values.values())), bounds=(-5, 5))
        noise = float(np.sqrt(np.mean(fit.fun**2))) / SIZE
        # parameters must not absorb it, and priors reach the fitted values
        if not _NOISE[0] < noise / reach < _NOISE[1]:
            continue
        return name, t, truth + noise * rng.normal(size=ROWS), fault


def main(argv: list[str] | None = None) -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--cases", type=int, default=20)
    asked.add_argument("--first", type=int, default=870000)
    asked.add_argument("--kinds", nargs="+", default=list(KINDS))
    given = asked.parse_args(argv)
    warnings.simplefilter("ignore")
    for kind in given.kinds:
        counts: Counter[str] = Counter()
        for k in range(given.cases):
            hidden = OTHERS[k % len(OTHERS)] if kind == "others" else kind
            seed = given.first + 1000 * KINDS.index(kind) + k
            name, t, y, fault = case(hidden, seed)
            model = hs.PowerScaledSurrogate(
                simulator(name), surrogate=hs.ExactSurrogate(), n_draws=300, random_state=0
            )
            found = hs.DiscrepancyDiagnosis(model, cv=None, random_state=0).fit(t[:, None], y)
            first, alike = found.best_cause_, list(found.indistinguishable_)
            form = found.causes_["form"].iloc[0]
            counts[found.verdict_] += 1
            counts["p <= 0.05"] += found.p_value_ <= 0.05
            counts["store first"] += first.kind == "second-store"
            counts["store in set"] += "second-store" in alike
            counts["in series first"] += "in series" in form
            numbers = {k: round(v, 2) for k, v in fault.items() if k != "kind"}
            print(
                f"{seed} {name:9} {hidden:9} {found.verdict_:11} p {found.p_value_:.3f} {form:42}"
                f" {found.causes_['probability'].iloc[0]:.2f} {alike} {numbers}",
                flush=True,
            )
        print(kind, given.cases, dict(counts), flush=True)


if __name__ == "__main__":
    main()
