"""Linear time-invariant models: state space, transfer function, exact sampling, resonances."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import signal

from edge_service.messages.samples import Floats
from edge_service.models.bounds import require_positive
from edge_service.offline.reproduce.simulation import follow

Complexes = npt.NDArray[np.complex128]

_RIGID = 1e-6
"""Poles slower than this share of the fastest one count as rigid motion: a double pole at zero is
found only to the root of the machine's precision."""


def _evaluation_points(frequency_hz: Floats, period_s: float | None) -> Complexes:
    """s = j w, or z = exp(j w T), (f,)."""
    if not np.all(frequency_hz > 0.0):
        raise ValueError("frequency_hz must be greater than 0: at 0 a free axis has no answer")
    along_axis = 2j * np.pi * frequency_hz
    return np.asarray(along_axis if period_s is None else np.exp(along_axis * period_s))


@dataclass(frozen=True, slots=True, eq=False)
class TransferFunction:
    """Ratio of two polynomials in s, or in z where there is a period.

    Attributes:
        numerator, denominator: coefficients, highest power first, (n,).
        period_s: of the samples, s; None for continuous time.

    >>> lag = TransferFunction(np.array([3.0]), np.array([0.5, 1.0]))
    >>> lag.static_gain(), lag.poles().tolist()
    (3.0, [-2.0])
    """

    numerator: Floats
    denominator: Floats
    period_s: float | None = None

    def poles(self) -> Complexes:
        """Roots of the denominator, 1/s or (1)."""
        return np.asarray(np.roots(self.denominator))

    def frequency_response(self, frequency_hz: Floats) -> Complexes:
        """Output over input at frequencies (f,), Hz; complex, (f,).

        Raises:
            ValueError: a frequency is not greater than 0.
        """
        points = _evaluation_points(frequency_hz, self.period_s)
        return np.asarray(np.polyval(self.numerator, points) / np.polyval(self.denominator, points))

    def static_gain(self) -> float:
        """Output over a constant input in the end; infinite where the model integrates.

        Only for polynomials that share no root at rest (s = 0, z = 1).
        """
        at_rest, rounding = 0.0, 0.0
        if self.period_s is not None:  # there the coefficients must cancel each other
            at_rest, rounding = 1.0, 1e-12 * float(np.sum(np.abs(self.denominator)))
        above = float(np.polyval(self.numerator, at_rest))
        below = float(np.polyval(self.denominator, at_rest))
        return above / below if abs(below) > rounding else math.copysign(math.inf, above)


@dataclass(frozen=True, slots=True)
class Resonance:
    """One oscillating pair of poles, or what the pair was before sampling.

    Attributes:
        frequency_hz: undamped natural frequency |p| / 2 pi, Hz.
        damping_ratio: -Re p / |p|, (1).
    """

    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True, slots=True, eq=False)
class LinearModel:
    """x' = A x + B u, y = C x + D u; with a period x_{k+1} = A x_k + B u_k.

    Attributes:
        state_matrix: A, (n, n).
        input_matrix: B, (n, m).
        output_matrix: C, (p, n).
        feedthrough: D, (p, m).
        inputs, outputs: names with units, m and p of them.
        period_s: of the samples, s; None for continuous time.

    >>> lag = LinearModel(
    ...     np.array([[-2.0]]), np.array([[6.0]]), np.eye(1), np.zeros((1, 1)), ("u",), ("y",)
    ... )
    >>> lag.transfer_function("y", "u").static_gain()
    3.0
    >>> sampled = lag.sampled(0.1)
    >>> round(float(sampled.state_matrix[0, 0]), 6)  # exp(-0.2)
    0.818731
    """

    state_matrix: Floats
    input_matrix: Floats
    output_matrix: Floats
    feedthrough: Floats
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    period_s: float | None = None

    def __post_init__(self) -> None:
        states, inputs, outputs = len(self.state_matrix), len(self.inputs), len(self.outputs)
        for name, matrix, shape in (
            ("state_matrix", self.state_matrix, (states, states)),
            ("input_matrix", self.input_matrix, (states, inputs)),
            ("output_matrix", self.output_matrix, (outputs, states)),
            ("feedthrough", self.feedthrough, (outputs, inputs)),
        ):
            if matrix.shape != shape or not np.isfinite(matrix).all():
                raise ValueError(f"{name}: expected finite numbers of shape {shape}")

    def sampled(self, period_s: float) -> "LinearModel":
        """The model at samples of inputs that are held between them: exact, not Euler's.

        [A_d B_d; 0 1] = exp([A B; 0 0] T), the zero-order hold.

        Raises:
            ValueError: the model is sampled already, or the period is not greater than 0.
        """
        if self.period_s is not None:
            raise ValueError(f"the model is sampled already, at {self.period_s:g} s")
        require_positive(period_s=period_s)
        matrices = (self.state_matrix, self.input_matrix, self.output_matrix, self.feedthrough)
        transition, push, output, feedthrough, _ = signal.cont2discrete(
            matrices, period_s, method="zoh"
        )
        return LinearModel(
            transition, push, output, feedthrough, self.inputs, self.outputs, period_s
        )

    def transfer_function(self, output: str, source: str) -> TransferFunction:
        """From the input `source` to `output`; leading coefficients may be rounding noise.

        Raises:
            ValueError: there is no input or output of that name.
        """
        row, column = _index(output, self.outputs), _index(source, self.inputs)
        numerators, denominator = signal.ss2tf(
            self.state_matrix,
            self.input_matrix,
            self.output_matrix[row : row + 1],
            self.feedthrough[row : row + 1],
            input=column,
        )
        return TransferFunction(numerators[0], denominator, self.period_s)

    def frequency_response(self, frequency_hz: Floats) -> Complexes:
        """C (p I - A)^-1 B + D at frequencies (f,), Hz; complex, (f, outputs, inputs).

        Raises:
            ValueError: a frequency is not greater than 0.
        """
        points = _evaluation_points(frequency_hz, self.period_s)
        resolvent = points[:, None, None] * np.eye(len(self.state_matrix)) - self.state_matrix
        state = np.asarray(np.linalg.solve(resolvent, self.input_matrix))
        return np.asarray(self.output_matrix @ state + self.feedthrough)

    def resonances(self) -> tuple[Resonance, ...]:
        """Oscillating pairs of poles, slowest first; rigid motion and pure decay are none."""
        poles: Complexes = np.linalg.eigvals(self.state_matrix).astype(np.complex128)
        if self.period_s is not None:
            poles = np.asarray(np.log(poles) / self.period_s)
        fastest = float(np.max(np.abs(poles), initial=0.0))
        oscillating = poles[poles.imag > _RIGID * fastest]
        ordered = oscillating[np.argsort(np.abs(oscillating))]
        return tuple(
            Resonance(float(abs(p)) / (2.0 * math.pi), float(-p.real / abs(p))) for p in ordered
        )

    def respond(self, inputs: Floats, start: Floats | None = None) -> Floats:
        """Outputs (N, p) at the samples of inputs (N, m), from the state `start` (n,) or rest.

        Output k is what is measured when input k begins to act.

        Raises:
            ValueError: the model is not sampled, or a shape does not fit.
        """
        if self.period_s is None:
            raise ValueError("the model is continuous: sample it first")
        states = len(self.state_matrix)
        first = np.zeros(states) if start is None else start
        if first.shape != (states,) or inputs.shape != (len(inputs), len(self.inputs)):
            raise ValueError(
                f"expected inputs of shape (N, {len(self.inputs)}) and a start of ({states},), "
                f"got {inputs.shape} and {first.shape}"
            )
        forcing = np.vstack([first, inputs[:-1] @ self.input_matrix.T])[: len(inputs)]
        state = follow(np.ascontiguousarray(self.state_matrix), np.ascontiguousarray(forcing))
        return state @ self.output_matrix.T + inputs @ self.feedthrough.T


def _index(name: str, names: tuple[str, ...]) -> int:
    if name not in names:
        raise ValueError(f"{name}: no such signal; there are {', '.join(names)}")
    return names.index(name)
