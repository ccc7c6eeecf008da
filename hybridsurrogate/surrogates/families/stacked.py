"""Surrogates of several outputs, one for each, as one basis of rows that say which they are of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from hybridsurrogate.simulation.outputs import OUTPUT
from hybridsurrogate.surrogates.basis import Basis, Domain, Surrogate
from hybridsurrogate.types import FloatArray, Prior


def built_for_each(surrogate: Surrogate, domain: Domain, names: Sequence[str]) -> Basis:
    """Return a surrogate of each output on its rows of a domain; the simulation itself is one.

    Parameters
    ----------
    surrogate : Surrogate
    domain : Domain
        One of whose inputs is `OUTPUT`.
    names : sequence of str
        Of the outputs.
    """
    at = domain.input_names.index(OUTPUT)
    first = surrogate.build(_of_one(domain, at, 0))
    if isinstance(first, Basis) and first.is_simulation:
        return surrogate.build(domain)
    bases = [first, *(surrogate.build(_of_one(domain, at, k)) for k in range(1, len(names)))]
    return stacked(bases, at, names)


def stacked(bases: Sequence[Basis], at: int, names: Sequence[str]) -> Basis:
    """Return several bases as one; ``at`` is the column of inputs that says which."""
    mean, sd = (
        np.concatenate([getattr(one, word) for one in bases])
        for word in ("coefficient_mean", "coefficient_sd")
    )
    return StackedBasis(mean, sd, tuple(bases), at, tuple(names))


def _of_one(domain: Domain, at: int, k: int) -> Domain:
    """Return the domain of one output."""
    here = domain.X[:, at] == k
    eta = domain.eta[here]
    sd = float(np.std(eta))
    return replace(
        domain,
        input_ranges=np.delete(domain.input_ranges, at, axis=0),
        location=float(np.mean(eta)),
        scale=sd if sd > 0 else domain.scale,
        simulate=domain.simulate and partial(_simulated, domain.simulate, at, k),
        X=np.delete(domain.X[here], at, axis=1),
        omega=domain.omega[here],
        eta=eta,
        input_names=tuple(name for name in domain.input_names if name != OUTPUT),
    )


def _simulated(simulate: Any, at: int, k: int, X: FloatArray, omega: FloatArray) -> Any:
    """Return one output of the simulation."""
    return simulate(np.insert(X, at, float(k), axis=1), omega)


@dataclass(frozen=True)
class StackedBasis(Basis):
    """A basis for each of several outputs, with separate coefficients.

    Attributes
    ----------
    bases : tuple of Basis
    at : int
        The column of inputs that says which output a row is of.
    names : tuple of str
        Of the outputs.
    """

    bases: tuple[Basis, ...]
    at: int
    names: tuple[str, ...]

    @property
    def holds_runs(self) -> bool:  # type: ignore[override]
        """Whether the runs are in all of them."""
        return all(one.holds_runs for one in self.bases)

    @property
    def leaves_open(self) -> bool:  # type: ignore[override]
        """Whether one of them does."""
        return any(one.leaves_open for one in self.bases)

    def of_runs(self, X: FloatArray) -> FloatArray:
        """Return the inputs that a run has one value of: a run has all outputs."""
        return self.bases[0].of_runs(np.delete(X, self.at, axis=1))

    def open_at(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the covariance of the error at runs, all outputs together."""
        return np.sum([one.open_at(X, omega) for one in self.bases], axis=0)

    def between(self, X: FloatArray) -> FloatArray:
        """Return each row's error between the places of runs that are curves."""
        return self._row_by_row(X, lambda k, rows, inputs: self.bases[k].between(inputs))

    def scatter(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the scatter of each row's output between runs of a stochastic simulation."""
        return self._row_by_row(
            X, lambda k, rows, inputs: self.bases[k].scatter(inputs, omega[rows])
        )

    def unrepeated(self, X: FloatArray) -> FloatArray:
        """Return by how much each row's output differs between runs of near parameters."""
        return self._row_by_row(X, lambda k, rows, inputs: self.bases[k].unrepeated(inputs))

    @property
    def with_features(self) -> Basis | None:
        """Each with its features; None where one has none."""
        each = [one.with_features for one in self.bases]
        known = [one for one in each if one is not None]
        return stacked(known, self.at, self.names) if len(known) == len(each) else None

    @property
    def known_depends_on_hyper(self) -> bool:  # type: ignore[override]
        """Whether one of them is not linear in its unknowns."""
        return any(one.known_depends_on_hyper for one in self.bases)

    @property
    def hyperpriors(self) -> dict[str, Prior]:
        """Those of each, its output in front."""
        return {
            f"{name}: {key}": prior
            for name, one in zip(self.names, self.bases, strict=True)
            for key, prior in one.hyperpriors.items()
        }

    @cached_property
    def coefficients_of(self) -> list[slice]:
        """Where the coefficients of each are."""
        return _slices([len(one.coefficient_mean) for one in self.bases])

    @cached_property
    def _hyper(self) -> list[slice]:
        return _slices([len(one.hyperpriors) for one in self.bases])

    def _parts(self, X: FloatArray) -> list[tuple[int, NDArray[np.intp], FloatArray]]:
        """Return which rows each basis has, and their inputs."""
        inputs = np.delete(X, self.at, axis=1)
        rows = [np.flatnonzero(X[:, self.at] == k) for k in range(len(self.bases))]
        return [(k, own, inputs[own]) for k, own in enumerate(rows) if len(own)]

    def factor(self, hyper: FloatArray, truncated: bool = False) -> FloatArray | None:
        """Return those of each as blocks."""
        each = [one.factor(hyper[:, own]) for one, own in zip(self.bases, self._hyper, strict=True)]
        if all(one is None for one in each):
            return None
        plain = (np.repeat(np.diag(one.coefficient_sd)[None], len(hyper), 0) for one in self.bases)
        blocks = [a if b is None else b for a, b in zip(plain, each, strict=True)]
        return np.array([block_diag(*some) for some in zip(*blocks, strict=True)])

    def given(self, hyper: FloatArray) -> Basis:
        """Return each at fixed hyperparameters."""
        pairs = zip(self.bases, self._hyper, strict=True)
        return stacked([one.given(hyper[own]) for one, own in pairs], self.at, self.names)

    def known(
        self, X: FloatArray, omega: FloatArray, hyper: FloatArray | None = None
    ) -> FloatArray:
        """Return each row's known part."""

        def known(k: int, rows: NDArray[np.intp], inputs: FloatArray) -> FloatArray:
            own = None if hyper is None else hyper[rows, self._hyper[k]]
            return self.bases[k].known(inputs, omega[rows], own)

        return self._row_by_row(X, known)

    def features(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return each row's features, zero for the coefficients of other outputs."""
        out = np.zeros((len(X), len(self.coefficient_mean)))
        for k, rows, inputs in self._parts(X):
            out[rows, self.coefficients_of[k]] = self.bases[k].features(inputs, omega[rows])
        return out

    def error(self, X: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the factor of what each misses, which they do not share."""
        parts = self._parts(X)
        errors = [self.bases[k].error(inputs, omega[rows]) for k, rows, inputs in parts]
        out = np.zeros((len(X), sum(error.shape[1] for error in errors)))
        columns = _slices([error.shape[1] for error in errors])
        for (_, rows, _), error, own in zip(parts, errors, columns, strict=True):
            out[rows, own] = error
        return out

    def output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output of each row."""

        def output(k: int, rows: NDArray[np.intp], inputs: FloatArray) -> FloatArray:
            return self.bases[k].output(inputs, omega[rows], c[self.coefficients_of[k]])

        return self._row_by_row(X, output)

    def output_close_by(
        self, X: FloatArray, omega: FloatArray, c: FloatArray, shape: tuple[int, int, int]
    ) -> FloatArray:
        """Return the output of rows of ``shape``, each basis along its slopes."""
        nodes, moves, _ = shape

        def output(k: int, rows: NDArray[np.intp], inputs: FloatArray) -> FloatArray:
            own = nodes, moves, len(rows) // (nodes * moves)
            coefficients = c[self.coefficients_of[k]]
            return self.bases[k].output_close_by(inputs, omega[rows], coefficients, own)

        return self._row_by_row(X, output)

    def outer_output(self, X: FloatArray, omega: FloatArray, c: FloatArray) -> FloatArray:
        """Return the output (J, n) of n inputs for each of J parameters."""
        out = np.empty((len(omega), len(X)))
        for k, rows, inputs in self._parts(X):
            own = c[..., self.coefficients_of[k]]
            out[:, rows] = self.bases[k].outer_output(inputs, omega, own)
        return out

    def outer(self, X: FloatArray, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return known part (J, n) and features (J, n, p) of n inputs for J parameters."""
        J, n = len(omega), len(X)
        known, features = np.empty((J, n)), np.zeros((J, n, len(self.coefficient_mean)))
        for k, rows, inputs in self._parts(X):
            known[:, rows], own = self.bases[k].outer(inputs, omega)
            features[:, rows, self.coefficients_of[k]] = own
        return known, features

    def _row_by_row(
        self, X: FloatArray, of: Callable[[int, NDArray[np.intp], FloatArray], FloatArray]
    ) -> FloatArray:
        out = np.empty(len(X))
        for k, rows, inputs in self._parts(X):
            out[rows] = of(k, rows, inputs)
        return out


def _slices(lengths: Sequence[int]) -> list[slice]:
    ends = np.cumsum([0, *lengths]).tolist()
    return [slice(a, b) for a, b in pairwise(ends)]
