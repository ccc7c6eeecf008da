"""Hierarchies in coordinates in which they are close to independent standard normal numbers.

A parameter of experiment e is ``p_e = mean + spread u_e`` with u_e standard normal. Where the rows
of each experiment determine p_e well, mean, spread and u_e lie on a bent ridge; where they
determine it poorly, mean, spread and p_e do (Papaspiliopoulos, Roberts and Skoeld 2007, Statistical
Science 22:59). Let the likelihood of the rows of e be normal in p_e, with mean r_e and variance
v_e. Given mean and spread, p_e is then normal with variance
``V_e = 1 / (1 / spread^2 + 1 / v_e)`` and mean ``V_e (mean / spread^2 + r_e / v_e)``. The
coordinate is p_e standardised by these, at any spread.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hybridsurrogate.inference.conjugate.target import Target
from hybridsurrogate.inference.sampling.importance import Proposals
from hybridsurrogate.inference.sampling.modes import LogDensity, find_modes
from hybridsurrogate.model.observation import MeasuredModel
from hybridsurrogate.numerics.linear_algebra import SINGULAR
from hybridsurrogate.priors import from_normal, prior_sd, to_normal
from hybridsurrogate.types import FloatArray, Prior


class Hierarchy(NamedTuple):
    """Positions in z of a mean, a spread and the deviations, and the likelihood of each p_e.

    It is normal around ``location + slopes @ x`` with the ``precision`` 1 / v_e. The unit is the
    prior's standard deviation, counted from its median; x are the other coordinates ``others`` at
    the place of the expansion.
    """

    mean: int
    spread: int
    deviations: NDArray[np.intp]
    location: FloatArray
    precision: FloatArray
    slopes: FloatArray
    others: NDArray[np.intp]


def hierarchies(model: MeasuredModel) -> list[Hierarchy]:
    """Return the hierarchies among the unknowns of a model, with flat likelihoods."""
    parameters = list(model.parameters)
    own = {name: model.n_parameters + i for i, name in enumerate(model.theta_names)}
    found = []
    for k, effect in enumerate(model.effects):
        if effect.hierarchy is not None:
            mean, spread, deviations = effect.hierarchy
            places = np.array([own[k, name] for name in deviations])
            nothing = np.zeros(len(places))
            found.append(
                Hierarchy(
                    parameters.index(mean),
                    own[k, spread],
                    places,
                    nothing,
                    nothing,
                    np.empty((len(places), 0)),
                    places[:0],
                )
            )
    return found


@dataclass(frozen=True)
class Coordinates:
    """Coordinates in which the deviations of hierarchies are standardised.

    Attributes
    ----------
    priors : sequence of prior
        Of the unknowns z.
    hierarchies : tuple of Hierarchy
    """

    priors: Sequence[Prior]
    hierarchies: tuple[Hierarchy, ...]

    def _between(self, x: FloatArray, one: Hierarchy) -> tuple[FloatArray, FloatArray]:
        """Return mean and spread (J, 1) of p_e, in units of the prior's sd, from its median."""
        priors = self.priors
        middle, sd = float(priors[one.mean].median()), prior_sd(priors[one.mean])
        mean = from_normal([priors[one.mean]], x[:, [one.mean]])
        spread = from_normal([priors[one.spread]], x[:, [one.spread]])
        return (mean - middle) / sd, np.maximum(spread / sd, SINGULAR)

    def _given_rows(self, x: FloatArray, one: Hierarchy) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (J, E) of p_e given its rows, in the same units."""
        mean, spread = self._between(x, one)
        if np.isinf(one.precision).all():
            return np.zeros_like(mean), np.ones_like(mean)
        # V / spread^2, which stays finite where the spread is next to nothing
        share = 1 / (1 + spread**2 * one.precision)
        estimated = one.location + x[:, one.others] @ one.slopes.T
        return share * mean + (1 - share) * estimated, spread * np.sqrt(share)

    def of(self, points: FloatArray) -> FloatArray:
        """Return the coordinates of plain points (J, d), or with more columns."""
        given = points.copy()
        for one in self.hierarchies:
            mean, spread = self._between(points, one)
            given[:, one.deviations] = mean + spread * points[:, one.deviations]
        out = given.copy()
        for one in self.hierarchies:
            centre, sd = self._given_rows(given, one)
            out[:, one.deviations] = (given[:, one.deviations] - centre) / sd
        return out

    def points(self, coordinates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return plain points and the log of their volume for that of the coordinates, (J,)."""
        given, log_volume = coordinates.copy(), np.zeros(len(coordinates))
        out = coordinates.copy()
        for one in self.hierarchies:
            (mean, spread), (centre, sd) = self._between(given, one), self._given_rows(given, one)
            own = centre + sd * coordinates[:, one.deviations]
            given[:, one.deviations] = own
            out[:, one.deviations] = (own - mean) / spread
            log_volume += np.sum(np.log(np.broadcast_to(sd / spread, own.shape)), axis=1)
        return out, log_volume

    def density(self, log_density: LogDensity, coordinates: FloatArray) -> FloatArray:
        """Return the log density of coordinates (J, d), given that of plain points."""
        points, log_volume = self.points(coordinates)
        return log_density(points) + log_volume


def standardised(
    model: MeasuredModel, log_density: LogDensity, starts: FloatArray
) -> Coordinates | None:
    """Return coordinates that suit the hierarchies of a density; None where it has none.

    The likelihood of each experiment is expanded where the spread is as wide as the parameter's
    prior, so that its rows alone determine it.

    Parameters
    ----------
    model : MeasuredModel
    log_density : callable
        Of plain points (J, d), at least approximately.
    starts : ndarray of shape (k, d)
        Plain points from which to climb.
    """
    found = hierarchies(model)
    if not found:
        return None
    # if rows determined everything, coordinates would be the p_e themselves
    sure = [one._replace(precision=np.full(len(one.location), np.inf)) for one in found]
    centred = Coordinates(model.priors, tuple(sure))
    wide = centred.of(starts)
    for one in found:
        sd = prior_sd(model.priors[one.mean])
        wide[:, one.spread] = to_normal([model.priors[one.spread]], [sd])[0]
    free = np.setdiff1d(np.arange(wide.shape[1]), [one.spread for one in found])

    def at_wide_spread(x: FloatArray) -> FloatArray:
        points = np.repeat(wide[:1], len(x), axis=0)
        points[:, free] = x
        return centred.density(log_density, points)

    mode = find_modes(at_wide_spread, wide[:, free], model.least_step)[0]
    covariance = mode.factor @ mode.factor.T
    place = {position: k for k, position in enumerate(free)}
    means, deviations = {one.mean for one in found}, {k for one in found for k in one.deviations}
    given = [k for k in free if k not in means | deviations]
    out = []
    for one in found:
        a, b = [place[k] for k in one.deviations], [place[k] for k in given]
        slopes = np.linalg.lstsq(covariance[np.ix_(b, b)], covariance[np.ix_(b, a)], rcond=None)[0]
        rest = np.diag(covariance[np.ix_(a, a)] - slopes.T @ covariance[np.ix_(b, a)])
        out.append(
            one._replace(
                location=mode.mean[a] - slopes.T @ mode.mean[b],
                # the prior of p_e had a precision of one
                precision=np.maximum(1 / rest - 1.0, 0.0),
                slopes=slopes.T,
                others=np.array(given, dtype=np.intp),
            )
        )
        # the next one is estimated given this one
        given = [*given, *one.deviations]
    return Coordinates(model.priors, tuple(out))


@dataclass(frozen=True)
class HierarchicalTarget(Target):
    """A density in other coordinates; everything else is that of ``plain``."""

    plain: Target
    coordinates: Coordinates

    def __getattr__(self, word: str) -> Any:
        return getattr(self.plain, word)

    @property
    def n_noise(self) -> int:
        """Length of the standard normal e that stands for coefficients in points [u, e]."""
        return self.plain.n_noise

    def search_density(self, u: FloatArray) -> FloatArray:
        """Return the log density of u (J, d), at least approximately."""
        return self.coordinates.density(self.plain.search_density, u)

    def extended_log_density(self, points: FloatArray) -> FloatArray:
        """Return the exact log density of [u, e] (J, d + n_noise)."""
        return self.coordinates.density(self.plain.extended_log_density, points)

    def resolved(
        self, points: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return plain u, c and a of extended points."""
        return self.plain.resolved(self.coordinates.points(points)[0], random_state)

    def joint_log_density(self, w: FloatArray) -> FloatArray:
        """Return the exact log density of what an ensemble walks over: u, or [u, v]."""
        return self.coordinates.density(self.plain.joint_log_density, w)

    def to_ensemble(self, points: FloatArray) -> FloatArray:
        """Return the places over which an ensemble walks of extended points."""
        return self.coordinates.of(self.plain.to_ensemble(self.coordinates.points(points)[0]))

    def from_ensemble(
        self, w: FloatArray, random_state: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return plain u, c and a of places over which an ensemble walked."""
        return self.plain.from_ensemble(self.coordinates.points(w)[0], random_state)

    def plain_proposals(self, proposals: Proposals) -> Proposals:
        """Return proposals as plain points with their densities."""
        points, log_volume = self.coordinates.points(proposals.points)
        return replace(proposals, points=points, log_density=proposals.log_density - log_volume)
