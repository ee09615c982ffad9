"""Access to the OPC UA server, as the configuration asks for it."""

from collections.abc import Callable

from ...bus.opcua.application import OpcuaError, OpcuaSettings, application_uri
from ...config import ConfigError, EdgeConfig
from ..wiring.http_rights import doorkeeper_of, server_files


def opcua_settings(config: EdgeConfig) -> OpcuaSettings:
    """Settings of the server, with files that can be used. Raises ConfigError."""
    opcua = config.opcua
    if opcua is None:
        raise ConfigError("opcua: missing; the node needs an [opcua] table")
    pair = server_files("opcua", opcua.certificate, opcua.private_key)
    try:
        application_uri(opcua.certificate)
    except OpcuaError as error:
        raise ConfigError(f"opcua.certificate: {error}") from None
    certificate, key = pair or (None, None)
    machine = f"{config.service.site}/{config.service.machine}"
    return OpcuaSettings(
        opcua.host, opcua.port, machine, certificate, key, _knows(config), opcua.sessions
    )


def _knows(config: EdgeConfig) -> Callable[[str, str], bool] | None:
    """Users are the tokens of `[http]`: their names, and as passwords what proves them."""
    if config.http.tokens_file is None:
        return None
    doorkeeper = doorkeeper_of(config.http)

    def knows(user: str, password: str) -> bool:
        name = doorkeeper.identify(f"Bearer {password}", "").name
        return name is not None and name == user

    return knows
