"""A scikit-learn kernel that looks at some columns only."""

from __future__ import annotations

from typing import Any

import numpy as np
from hidden_effects.simulations import Array
from sklearn.gaussian_process.kernels import Hyperparameter, Kernel


class Over(Kernel):
    """Any kernel over one or several columns; hyperparameters are the kernel's own.

    scikit-learn's kernels look at all columns alike; a structure search needs one for each.
    """

    def __init__(self, kernel: Kernel, columns: tuple[int, ...]):
        self.kernel = kernel
        self.columns = columns

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        found = {"kernel": self.kernel, "columns": self.columns}
        if deep:
            found |= {f"kernel__{name}": v for name, v in self.kernel.get_params().items()}
        return found

    @property
    def hyperparameters(self) -> list[Hyperparameter]:
        return [
            Hyperparameter(f"kernel__{h.name}", h.value_type, h.bounds, h.n_elements, h.fixed)
            for h in self.kernel.hyperparameters
        ]

    @property
    def theta(self) -> Array:
        return self.kernel.theta

    @theta.setter
    def theta(self, theta: Array) -> None:
        self.kernel.theta = theta

    @property
    def bounds(self) -> Array:
        return self.kernel.bounds

    def __call__(self, X: Array, Y: Array | None = None, eval_gradient: bool = False) -> Any:
        columns = list(self.columns)
        other = None if Y is None else Y[:, columns]
        return self.kernel(X[:, columns], other, eval_gradient)

    def diag(self, X: Array) -> Array:
        return self.kernel.diag(X[:, list(self.columns)])

    def is_stationary(self) -> bool:
        return self.kernel.is_stationary()

    def __repr__(self) -> str:
        return f"{self.kernel} over {np.array(self.columns)}"
