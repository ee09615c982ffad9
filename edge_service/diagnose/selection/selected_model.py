"""Selected model of a session: the posterior over sets of effects, and what the best one leaves."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ...messages.samples import Floats
from ...models.machine import Machine
from ..candidates.force_pulses import FORCE
from ..session.session import Session
from .beside_force import beside_force
from .noise import noise_of_residual
from .posterior import Posterior, select_effects
from .problem import SelectionProblem


@dataclass(frozen=True, slots=True, eq=False)
class SelectedModel:
    """Session, the selection problem that it poses, and the posterior that answers it.

    Attributes:
        unexplained: share of each channel's energy above the floor that the best set leaves.
    """

    session: Session
    machine: Machine
    problem: SelectionProblem
    posterior: Posterior
    unexplained: Mapping[str, float]

    def residuals(self) -> dict[str, Floats]:
        """Residual of the best set with all shapes that bear its names, by channel, (n,)."""
        return self.problem.residuals(self.session, self.posterior.best.fit)

    def with_posterior(self, posterior: Posterior) -> "SelectedModel":
        """Replace the posterior, and what its best set leaves."""
        shares = self.problem.noise.unexplained_shares(self.session, posterior.best.fit.rms)
        return replace(self, posterior=posterior, unexplained=shares)

    def exceeds_floor(self, *channels: str) -> bool:
        """Tell whether one of some channels was recorded and its gap matters."""
        noise, recorded = self.problem.noise, self.session.channels
        return any(noise.matters(name, recorded[name].rms) for name in channels if name in recorded)


def select_model(session: Session, machine: Machine, problem: SelectionProblem) -> SelectedModel:
    """Select effects twice: the residual of the first selection shows the noise of the second."""
    first = select_effects(problem).best.fit
    left = problem.residuals(session, first)
    noise = noise_of_residual(session, machine, problem.noise, left)
    problem = replace(problem, noise=noise)
    posterior = select_effects(problem, first.chosen)
    left_rms: Mapping[str, float] = posterior.best.fit.rms
    if FORCE in posterior.best.material:
        posterior, left_rms = beside_force(session, problem, posterior)
    shares = noise.unexplained_shares(session, left_rms)
    return SelectedModel(session, machine, problem, posterior, shares)
