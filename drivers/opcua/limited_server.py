"""A server with the limits of a SINUMERIK: 100 ms, few sessions, and it says so."""

from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.subscription_service import SubscriptionService
from asyncua.ua.status_codes import StatusCodes

LEAST_INTERVAL_S = 0.1
MOST_SESSIONS = 10
_NOBODY = User(role=UserRole.Anonymous)


class LimitedServer(InternalServer):
    """Gives clients longer intervals than they ask for, and refuses sessions beyond the last."""

    def __init__(self, user_manager: Any) -> None:
        super().__init__(user_manager)
        self.subscription_service = _LimitedSubscriptions(self.aspace, iserver=self)

    def create_session(
        self, name: str, user: User = _NOBODY, external: bool = False
    ) -> InternalSession:
        """A session, unless there are too many. Raises ServiceError."""
        if external and len(self._external_sessions) >= MOST_SESSIONS:
            raise ServiceError(StatusCodes.BadTooManySessions)
        return super().create_session(name, user, external)


class _LimitedSubscriptions(SubscriptionService):
    async def create_subscription(
        self, params: ua.CreateSubscriptionParameters, *args: Any, **kwargs: Any
    ) -> ua.CreateSubscriptionResult:
        """A subscription at the interval asked for, or at the shortest there is."""
        params.RequestedPublishingInterval = max(
            params.RequestedPublishingInterval, 1e3 * LEAST_INTERVAL_S
        )
        return await super().create_subscription(params, *args, **kwargs)
