"""Parameters that a server grants on request, and the limits that it names."""

from dataclasses import dataclass

from asyncua.ua.object_ids import ObjectIds


@dataclass(frozen=True, slots=True)
class Granted:
    """Granted parameters: intervals in s, values that the server queues, limits that it names."""

    publishing_s: float
    sampling_s: float
    queue_size: int
    limits: dict[str, float]

    def as_readings(self) -> dict[str, float]:
        """Granted values by name."""
        return {
            "publishing_s": self.publishing_s,
            "sampling_s": self.sampling_s,
            "queue_size": float(self.queue_size),
        } | self.limits


LIMITS = {
    "min_supported_sample_s": (ObjectIds.Server_ServerCapabilities_MinSupportedSampleRate, 1e-3),
    "max_sessions": (ObjectIds.Server_ServerCapabilities_MaxSessions, 1.0),
    "max_monitored_items_per_call": (
        ObjectIds.Server_ServerCapabilities_OperationLimits_MaxMonitoredItemsPerCall,
        1.0,
    ),
}
"""Name -> variable of the server and its factor to SI; servers may lack them."""
