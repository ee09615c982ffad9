"""The service's configuration and machine files: read, checked, every mistake told by its key."""

from .loading import DEFAULT_CONFIG as DEFAULT_CONFIG
from .loading import check_settings as check_settings
from .loading import load_config as load_config
from .loading import load_machine as load_machine
from .loading import read_axis as read_axis
from .loading import read_config as read_config
from .loading import state_folder as state_folder
from .mistakes import ConfigError as ConfigError
from .service import DEFAULT_MACHINE as DEFAULT_MACHINE
from .service import AxisConfig as AxisConfig
from .service import EdgeConfig as EdgeConfig
from .service import EstimatorConfig as EstimatorConfig
from .service import HttpConfig as HttpConfig
