"""Simulations given by the right-hand side of an ordinary differential equation.

simulator    OdeSimulator: states, right-hand side, solver
function     the equation as a function of arrays, and checks of what it returns
steps        steps as short as the solutions need, and the choice of a method
integration  the solvers, vectorised over sets of parameters
rosenbrock   the solver for stiff equations, with steps for each solution
dynamics     changes of the right-hand side: courses of a rate, terms, delays, an unseen store
"""

from hybridsurrogate.ode.simulator import OdeSimulator

__all__ = ["OdeSimulator"]
