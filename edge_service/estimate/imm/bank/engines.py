"""Filter banks by method and engine."""

from typing import Literal

from ....messages.samples import Floats
from .filter_bank import FilterBank


def make_filter_bank(
    method: Literal["kf-imm", "sif-imm"],
    engine: Literal["compiled", "filterpy"] = "compiled",
    boundary: Floats | None = None,
) -> FilterBank:
    """A filter bank by name.

    Args:
        method: Kalman filters, or sliding innovation filters.
        engine: our compiled kernel, or filterpy's IMMEstimator (Kalman filters only; slow).
        boundary: delta of the sliding innovation filter, one width per measurement, (m,).

    Raises ValueError for a combination that does not exist.
    """
    if (method, engine) == ("kf-imm", "compiled"):
        from .kalman import CompiledKalmanBank

        return CompiledKalmanBank()
    if (method, engine) == ("kf-imm", "filterpy"):
        from .filterpy_engine import FilterpyBank

        return FilterpyBank()
    if (method, engine) == ("sif-imm", "compiled"):
        from .sliding_innovation import SlidingInnovationBank

        if boundary is None:
            raise ValueError("sif-imm: a boundary is needed, one width per measurement")
        return SlidingInnovationBank(boundary)
    if (method, engine) == ("sif-imm", "filterpy"):
        raise ValueError("sif-imm: filterpy has no sliding innovation filter; use compiled")
    raise ValueError(f"no filter bank {method} with engine {engine}")
