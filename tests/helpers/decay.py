"""One state that decays, as an ODE."""

from __future__ import annotations

import hybridsurrogate as hs


def make_decay(**settings):
    given = {
        "rhs": lambda t, state, rate: -rate * state,
        "initial_state": [2.0],
        "observe": lambda state: state[0],
        "inputs": {"t": (1, 5)},
        "parameters": {"rate": hs.truncated_normal(1, 0.5, 0, 3)},
        "states": "n",
    }
    return hs.OdeSimulator(**(given | settings))
