"""A ball-screw axis that shares no code with the library: the truth of the benches."""

from .ageing import Lubricant, Payload, ProcessForce, Ramp, Relubrication, Steps, Warmup
from .axis import axis_case, commissioning_case
from .bench import case
from .faults import FAULTS
from .gap import gap
from .machine import DIAGNOSIS, Machine, nominal_machine_toml
from .motions import part_programme
from .oddities import ALL, ODDITIES
from .simulate import Case, Recording, simulate

__all__ = ["ALL", "DIAGNOSIS", "FAULTS", "ODDITIES", "Case", "Lubricant", "Machine", "Payload"]
__all__ += ["ProcessForce", "Ramp", "Recording", "Relubrication", "Steps", "Warmup", "simulate"]
__all__ += ["axis_case", "case", "commissioning_case", "gap", "nominal_machine_toml"]
__all__ += ["part_programme"]
