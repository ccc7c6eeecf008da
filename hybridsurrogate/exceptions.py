"""Warnings that this package raises about doubtful results and inputs."""


class HybridSurrogateWarning(UserWarning):
    """Base class of every warning of this package."""


class FailedRunsWarning(HybridSurrogateWarning):
    """Some simulation runs failed and were dropped."""


class RowByRowWarning(HybridSurrogateWarning):
    """A simulation that was to take arrays takes numbers only, and is called row by row."""


class ExtrapolationWarning(HybridSurrogateWarning):
    """Measured or predicted inputs, or all measured outputs, lie outside what was simulated."""


class SamplingWarning(HybridSurrogateWarning):
    """The draws from a posterior are not trustworthy."""


class SolverWarning(HybridSurrogateWarning):
    """The solutions of an ODE depend on the step of the solver."""


class PriorWarning(HybridSurrogateWarning):
    """A prior and the simulated range hardly overlap."""


class DiagnosisWarning(HybridSurrogateWarning):
    """A diagnosis rests on too little, or something was left out of it."""


class ConfoundingWarning(DiagnosisWarning):
    """The data cannot tell a cause from a parameter of the simulation."""
